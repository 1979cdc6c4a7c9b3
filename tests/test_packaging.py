"""What is shipped: its types, its dependencies, its first second, its help."""

import ast
import re
import sys
import tomllib
from functools import cache
from importlib.metadata import packages_distributions

import pytest

from hysteresis import InputError, Record
from hysteresis._registry import OURS, find_model
from identify import fit
from tests.c_harness import ran
from tests.sources import PACKAGES, ROOT, trees
from tests.test_hysid.command import COMMANDS, ENVIRONMENT

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
EXTRAS = PROJECT["optional-dependencies"]
WANTED = [*PROJECT["dependencies"], *(one for extra in EXTRAS.values() for one in extra)]

HEAVY = (
    "jax", "numpy", "scipy", "scipy.stats", "pandas", "matplotlib", "identify", "compensate",
)  # fmt: skip

BROUGHT = {
    "PIL": "matplotlib", "jaxlib": "jax", "lineax": "optimistix",
    "llvmlite": "numba",
    "xarray": "arviz", "click": "typer", "mpl_toolkits": "matplotlib", "sklearn": "scikit-learn",
    "typing_extensions": "optimistix", "traitlets": "anywidget",
}  # fmt: skip
"""Import names of what a dependency cannot do without and brings along, or is known by."""


def name_of(wanted: str) -> str:
    return re.split(r"[<>=!~ \[]", wanted)[0].lower().replace("_", "-")


DECLARED = {name_of(wanted) for wanted in WANTED}


@pytest.mark.parametrize("package", PACKAGES)
def test_packages_are_typed(package: str):
    assert (ROOT / package / "py.typed").is_file()


@pytest.mark.parametrize("wanted", WANTED)
def test_dependencies_have_a_lowest_version_and_no_highest(wanted: str):
    """`make minimum` installs the lowest; a cap keeps users from mending anything."""
    assert re.fullmatch(r"[\w.-]+>=[\w.]+", wanted), wanted


def test_a_dependency_has_one_lowest_version():
    lowest: dict[str, set[str]] = {}
    for wanted in WANTED:
        lowest.setdefault(name_of(wanted), set()).add(wanted)
    assert {name: said for name, said in lowest.items() if len(said) > 1} == {}


@cache
def owners_of_names() -> dict[str, list[str]]:
    return dict(packages_distributions())


@cache
def imported() -> dict[str, str]:
    """The names of absolute imports, and a place of each."""
    found = {}
    for file, tree in trees().items():
        for node in ast.walk(tree):
            names: list[str] = []
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
                names = [node.module]
            found |= {name.partition(".")[0]: f"{file}:{node.lineno}" for name in names}
    return found


def test_what_is_imported_is_declared():
    """Else it works where another package happens to bring it."""
    owners = owners_of_names()
    undeclared = {}
    for name, place in imported().items():
        if name in sys.stdlib_module_names or name in PACKAGES:
            continue
        name = BROUGHT.get(name, name)
        if not {name_of(one) for one in (name, *owners.get(name, ()))} & DECLARED:
            undeclared[name] = place
    assert undeclared == {}


def test_every_dependency_is_imported():
    """What nobody imports, everybody would install."""
    owners = owners_of_names()
    owned = {name_of(one) for name in imported() for one in (name, *owners.get(name, ()))}
    assert sorted({name_of(wanted) for wanted in PROJECT["dependencies"]} - owned) == []


def test_a_start_is_light():
    """JAX takes a second, which nobody has who asks for help or presses tab; SciPy's statistics take 0.4 s,
    which neither a check of a file nor a prediction needs."""
    code = "import sys\n" + "".join(
        f"{step}\nprint([m for m in {HEAVY} if m in sys.modules])\n"
        for step in (
            "import hysid",
            "from hysid.cli import _app\nimport typer\ntyper.main.get_command(_app.app)",
            "from hysid._catalogue import catalogue\ncatalogue()",
            "import hysid.commands._predict, hysid.commands._check, compensate",
        )
    )
    code += "import hysid.commands._demo, hysid.commands._microchannel\n"
    code += "print([m for m in sys.modules if m.startswith('hysid.reproduction')])"
    *light, last, papers = ran(sys.executable, "-c", code, env=ENVIRONMENT).stdout.splitlines()
    assert light == ["[]"] * 3
    assert "jax" in last
    assert "scipy.stats" not in last
    assert papers == "[]"  # they are 2,000 lines


def completed(words: str) -> list[str]:
    """What pressing tab at the end of these words offers in bash."""
    pressed = {"COMP_WORDS": words, "COMP_CWORD": str(len(words.split(" ")) - 1)}
    environment = ENVIRONMENT | pressed | {"_HYSID_COMPLETE": "complete_bash"}
    return ran(sys.executable, "-m", "hysid", env=environment).stdout.split()


def test_the_shell_completes_commands_and_options():
    assert completed("hysid da") == ["datasheet", "datasets"]
    assert "--test-cycles" in completed("hysid fit --te")
    assert completed("hysid datasets f") == ["fetch"]


def test_help_lists_the_models():
    with pytest.raises(InputError) as told:
        fit(Record.from_arrays([0.0, 1.0], [0.0, 1.0]), "nothing")
    ours = [
        name
        for name in told.value.problem.removesuffix(".").partition("have ")[2].split(", ")
        if (known := find_model(name)) is None or known.kind.__module__.startswith(OURS)
    ]
    (option,) = (p for p in COMMANDS["fit"].params if p.name == "model")
    listed = option.help.partition("in any case: ")[2].partition(", or a model")[0].split(", ")
    assert sorted(listed) == sorted(ours)
