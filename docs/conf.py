"""The documentation, built by Sphinx: `make docs`.

Pages are plain Markdown. The Python of a page is run as one notebook, so the output shown is what the code
gives. `console` blocks show what a command prints, `{api} package` blocks list names that are documented
from their docstrings, and equations are TeX between dollar signs. The helpers are in tools/.
"""

import inspect
import json
import logging
import os
import sys
import warnings
from importlib.metadata import version as version_of
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
OUT = HERE.parent / "out"
sys.path[:0] = [str(HERE / "tools"), str(HERE.parent)]
# Inherited by the kernels that run the pages, which compile the same programs.
for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")  # small matrices; two pages at a time
os.environ.setdefault("JAX_PLATFORMS", "cpu")
os.environ["JAX_ENABLE_X64"] = "1"
os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(OUT / ".compiled"))
os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0.2")
# A profile of their own: no start-up files of the user, no message about how kernels communicate.
os.environ["PYDEVD_DISABLE_FILE_VALIDATION"] = "1"
os.environ["IPYTHONDIR"] = str(OUT / ".ipython")
_PROFILE = OUT / ".ipython" / "profile_default"
_PROFILE.mkdir(parents=True, exist_ok=True)
(_PROFILE / "ipython_kernel_config.json").write_text(json.dumps({"IPKernelApp": {"log_level": 40}}))
# Pages are read by forked processes (-j), in which JAX is imported and runs nothing.
warnings.filterwarnings("ignore", message=r"os\.fork\(\) was called", category=RuntimeWarning)
logging.getLogger("traitlets").setLevel(logging.WARNING)

import cells  # noqa: E402
import docstrings  # noqa: E402
import error_codes  # noqa: E402
import public  # noqa: E402

project = "hysid"
author = "The hysid developers"
project_copyright = author
version = release = version_of("hysid")
extensions = ["myst_nb", "sphinx.ext.autodoc", "mathematics"]
exclude_patterns = ["tools", "template"]
nitpicky = True
smartquotes = False  # options begin with two dashes
highlight_language = "none"
python_use_unqualified_type_names = True
toc_object_entries_show_parents = "hide"

myst_enable_extensions = ["colon_fence", "dollarmath"]
myst_heading_anchors = 3
nb_execution_mode = "force"
nb_execution_timeout = 900
nb_execution_raise_on_error = False  # a warning, which is fatal in the end
nb_execution_show_tb = True
nb_merge_streams = True
nb_output_stderr = "warn"

autodoc_default_options = {"members": True}
autodoc_typehints = "none"
autodoc_inherit_docstrings = False
autodoc_member_order = "bysource"
autodoc_class_signature = "mixed"

pygments_dark_style = "monokai"
html_theme = "furo"
html_title = "hysid"
html_static_path = ["_static"]
html_css_files = ["hysid.css"]
html_math_renderer = "mathtext"
html_copy_source = False
html_show_sphinx = False
html_theme_options = {
    "light_css_variables": {"color-brand-primary": "#005f94", "color-brand-content": "#005f94"},
    "dark_css_variables": {"color-brand-primary": "#6cb8e6", "color-brand-content": "#6cb8e6"},
}

_HOMES = public.public_names()
_CLASSES: dict[Any, str] = {value: home for home, value in _HOMES.items() if inspect.isclass(value)}
_SHORT: dict[str, list[str]] = {}
for _home in _HOMES:
    _SHORT.setdefault(_home.rpartition(".")[2], []).append(_home)
_LINKS = {name: homes[0] for name, homes in _SHORT.items() if len(homes) == 1}
_LINKS |= {home: home for home in _HOMES}


def _read(app: Any, page: str, source: list[str]) -> None:
    text = cells.NAMES.sub(_documented, source[0])
    if error_codes.MARK in text:
        text = text.replace(error_codes.MARK, error_codes.table(HERE.parent))
    source[0] = cells.as_notebook(text)


def _documented(found: Any) -> str:
    return f"```{{eval-rst}}\n{public.directives(found[1], found[2].split())}```"


def _docstring(app: Any, what: str, name: str, value: Any, options: Any, lines: list[str]) -> None:
    lines[:] = docstrings.restructured("\n".join(lines), _LINKS).split("\n")


def _signature(
    app: Any, what: str, name: str, value: Any, options: Any, signature: str, returned: str
) -> tuple[str, str] | None:
    """Argument names and defaults; the result where it is a class of ours. Docstrings say the rest."""
    if what not in ("function", "method") or signature is None:
        return None
    home = _CLASSES.get(getattr(value, "__annotations__", {}).get("return"))
    return (signature, home) if home else None


def _skip(app: Any, what: str, name: str, value: Any, skip: bool, options: Any) -> bool | None:
    """Skip the fields of named tuples, which their class documents."""
    return True if type(value).__name__ == "_tuplegetter" else None


def setup(app: Any) -> None:
    app.connect("source-read", _read)
    app.connect("autodoc-process-docstring", _docstring)
    app.connect("autodoc-process-signature", _signature)
    app.connect("autodoc-skip-member", _skip)
