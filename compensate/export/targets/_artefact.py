"""What every target is made of: facts for its templates, a folder or an archive written whole."""

import json
import keyword
import re
import shutil
import subprocess
import tempfile
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hysteresis import InputError
from hysteresis._escape import c_comment, c_string, markup, visible
from hysteresis._files import atomic_file, naming

from ...runtime._file import checksum
from .._c99_header import STANDARD, header
from .._document import Moved
from .._export import Exported, Program
from .._header_facts import quantity

if TYPE_CHECKING:
    import jinja2

TEMPLATES = Path(__file__).parent / "templates"
MARK = "hysid-export.json"
"""Name of the runtime's file in every exported folder, which says that hysid may replace the folder."""
CLEARED = ", without hysteresis and creep"
COMPILE = ("-std=c99", "-O2", "-fPIC", "-shared", "-ffp-contract=off")


@dataclass
class Artefact:
    """The files of one export, by their path, before any of them is written."""

    program: Program
    stem: str
    real: str
    words: dict[str, Any] = field(default_factory=dict)
    files: dict[str, str | bytes] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        document = self.program.document(np.float32 if self.real == "float" else np.float64)
        document = {**document, "checksum": checksum(document)}
        self.document = document
        golden, guard = document["golden"], document["guard"]
        steps = sorted(golden["dt"][1:])
        own = ("rates", "condition", "reading", "estimate", "title", "limits", "start", "checksum")
        self.words |= {name: document[name] for name in own} | {
            "stem": self.stem,
            "upper": self.stem.upper(),
            "real": self.real,
            "trained": guard and (guard["parameters"]["low"], guard["parameters"]["high"]),
            "origin": document["origin"] or {"verdict": "", "codes": [], "date": "", "sha256": ""},
            "golden": len(golden["reading"]),
            "step": steps[len(steps) // 2] if steps else 0.0,  # the median, in the model's time
            "per_second": _per_second(self.program.time_unit) if document["rates"] else 1.0,
            "time_unit": self.program.time_unit,
            "cleared": "" if isinstance(self.program.model, Moved) else CLEARED,
            "hysid": version("hysid"),
        }
        if document["rates"] and self.program.time_unit in ("", "1"):
            self.notes.append(
                "The model's times have no unit: a target that counts seconds takes them for seconds."
            )

    def add_header(self, path: str) -> None:
        """The C99 header, the same that `hysid export --to c` writes."""
        self.files[path] = header(self.document, self.stem, single=self.real == "float")

    def add_runtime(self, path: str = MARK) -> None:
        """The runtime's file: model, units, trained inputs, verdict, date, checksum and golden pair."""
        self.files[path] = json.dumps(self.document) + "\n"

    def add_template(self, template: str, path: str) -> None:
        """A file made from templates/`template`."""
        self.files[path] = _environment().get_template(template).render(**self.words)

    def add_templates(self, folder: str, paths: Mapping[str, str]) -> None:
        """All files of a folder of templates: under their names, or the `paths` given for them."""
        for file in sorted(TEMPLATES.joinpath(folder).iterdir()):
            self.add_template(f"{folder}/{file.name}", paths.get(file.name, file.name))

    def written(self, out: Path) -> Exported:
        """The files and the runtime's as a folder, with what there is to mind."""
        self.add_runtime()
        return Exported(self.write_folder(out), (*self.program.notes, *self.notes))

    def write_folder(self, out: Path) -> Path:
        """All files below `out`, which replaces a folder that an earlier export wrote.

        A kill at any moment leaves the earlier folder or this one, whole: under its name, or for the
        moment between two renamings as `NAME.old-...` beside it, which the next export puts back.

        Raises `InputError` `would-overwrite` where there is anything else.
        """
        _put_back(out)
        replaced = out.is_dir() and (out / MARK).is_file()
        if out.exists() and not replaced and not (out.is_dir() and not any(out.iterdir())):
            raise InputError(
                "would-overwrite",
                "There is something else already, which no export has written.",
                place=str(out),
                fix="Give the name of a new folder.",
            )
        out.parent.mkdir(parents=True, exist_ok=True)
        new = Path(tempfile.mkdtemp(prefix=f"{out.name}.new-", dir=out.parent))
        try:
            with naming(out, new):
                for path, content in self.files.items():
                    _put(new / path, content)
            new.chmod(0o755)
            if out.exists() and not replaced:
                out.rmdir()
            elif replaced:
                out.rename(new.with_name(new.name.replace(".new-", ".old-")))
            new.rename(out)
            _put_back(out)
        except BaseException:
            shutil.rmtree(new, ignore_errors=True)
            _put_back(out)
            raise
        return out

    def write_archive(self, out: Path) -> Path:
        """All files in one ZIP archive, the same bytes from the same model."""
        with atomic_file(out) as new, zipfile.ZipFile(new, "w", zipfile.ZIP_DEFLATED) as archive:
            for path, content in self.files.items():
                entry = zipfile.ZipInfo(path, (1980, 1, 1, 0, 0, 0))
                entry.compress_type, entry.external_attr = zipfile.ZIP_DEFLATED, 0o644 << 16
                archive.writestr(entry, content)
        return out

    def add_compiled(self, path: str, unit: str, *options: str) -> None:
        """The shared library of `unit`, one of the C sources; only a note without a C compiler."""
        compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
        if compiler is None:
            self.notes.append("There is no C compiler here, so only sources were written.")
            return
        with tempfile.TemporaryDirectory() as place:
            for source, content in self.files.items():
                if source.endswith((".c", ".h")):
                    _put(Path(place, source), content)
            library = Path(place, "built.so")
            command = [compiler, *COMPILE, unit, *options, "-s", "-o", str(library), "-lm"]
            done = subprocess.run(command, cwd=place, capture_output=True, text=True)
            if done.returncode:
                said = visible((done.stderr.strip().splitlines() or ["no message"])[0])
                self.notes.append(f"The C compiler failed, so only sources were written: {said}")
            else:
                self.files[path] = library.read_bytes()


USED = frozenset({
    "arduino", "filters", "geometry_msgs", "mj", "mujoco", "numpy", "onnx", "pluginlib", "rclcpp",
    "sklearn", "std", "std_msgs", "std_srvs", *STANDARD, *keyword.kwlist,
})  # fmt: skip
"""Names of what exports include, import or depend on."""


def name_in_c(out: Path, *, lower: bool = False, used: frozenset[str] = USED) -> str:
    """The name of an export, from its file's or folder's. Raises `InputError` `bad-name`."""
    stem = out.stem if out.suffix in (".fmu", ".onnx", ".h") else out.name
    said, fix = f"{stem!r} cannot be the name of this export.", ""
    if not re.fullmatch(r"[a-z](_?[a-z0-9])*" if lower else r"[A-Za-z][A-Za-z0-9_]*", stem):
        kinds = "lower-case letters, digits and single _" if lower else "letters, digits and _"
        fix = f"{kinds}, a letter first."
    elif stem.lower() in used:
        said = f"{stem!r} is the name of something that exports use."
        fix = "give another name (--out)."
    if fix:
        raise InputError("bad-name", said, fix=fix)
    return stem


def _put_back(out: Path) -> None:
    """Folders that were renamed to be replaced: given back their name if nothing has it, else removed."""
    if not out.parent.is_dir():
        return
    for old in sorted(out.parent.iterdir()):
        if not old.name.startswith(f"{out.name}.old-") or not (old / MARK).is_file():
            continue
        if out.exists():
            shutil.rmtree(old, ignore_errors=True)
        else:
            old.rename(out)


def _put(file: Path, content: str | bytes) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_bytes(
        content.encode("utf-8", "backslashreplace") if isinstance(content, str) else content
    )


@cache
def _per_second(unit: str) -> float:
    """How much of the model's time passes in a second; 1 where its unit is not known."""
    if unit in ("", "1", "s"):
        return 1.0
    import pint  # takes 0.3 s to load

    try:
        return float(pint.Quantity(1.0, "s").to(unit).magnitude)
    except Exception as error:  # pint's own, the tokenizer's, and arithmetic errors for odd text
        raise InputError(
            "unknown-unit",
            f"{unit!r}, the unit of the model's times, is not a time.",
            fix="Name the unit of the time column where the fit reads it.",
        ) from error


@cache
def _environment() -> "jinja2.Environment":
    import jinja2  # takes 0.1 s to load

    made = jinja2.Environment(
        loader=jinja2.FileSystemLoader(TEMPLATES),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    line: Callable[[Any], str] = lambda text: " ".join(visible(str(text)).split())  # noqa: E731
    made.filters |= {"c_string": c_string, "c_comment": c_comment, "markup": markup, "line": line}
    made.filters |= {"json": json.dumps, "exact": repr, "quantity": quantity}
    return made
