"""Measured data of third parties: a list of where they are, and fetching one of them as a tidy CSV."""

import json
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Any, Literal, NamedTuple

from hysteresis import InputError
from hysteresis._escape import toml_comment, toml_string

_WHEEL = Path(__file__).parents[1] / "catalogue.toml"
_CHECKOUT = Path(__file__).resolve().parents[2] / "datasets" / "catalogue.toml"
SHIPPED = _WHEEL if _WHEEL.exists() else _CHECKOUT
"""The catalogue that comes with hysid."""

NOT_STATED = "none stated"


class File(NamedTuple):
    """One file of a data set: its path below the address, what is known of it, what to call it.

    - `bytes`: 0 where unknown. `sha256`: "" where nobody has checked it.
    """

    path: str
    bytes: int = 0
    sha256: str = ""
    label: str = ""


class Column(NamedTuple):
    """A column of the CSV: value = scale * (number in `cell` - zero), cells counted from 0.

    - `zero`: a number, or "first" for the file's first one.
    - `missing`: the number that stands for no reading.
    """

    name: str
    cell: int
    scale: float = 1.0
    zero: float | Literal["first"] = 0.0
    missing: float | None = None


class Layout(NamedTuple):
    """How a file is read: lines of `cells` cells, numbers in those that are wanted.

    - `separator`: "" for runs of blanks. `blocks`: the name of a column that numbers the blocks between
      empty lines; those of one line are left out.
    """

    separator: str
    cells: int
    columns: tuple[Column, ...]
    blocks: str = ""


@dataclass(frozen=True)
class Dataset:
    """An entry of the catalogue; `selection` and `fit` are the tables of `hysid fit --config`."""

    name: str
    what: str
    page: str
    base: str
    licence: str
    citation: str
    files: tuple[File, ...]
    layout: Layout
    selection: Mapping[str, Any]
    fit: Mapping[str, Any]
    notes: tuple[str, ...] = ()

    @property
    def bytes(self) -> int:
        """Of all files together."""
        return sum(file.bytes for file in self.files)

    @property
    def checked(self) -> bool:
        """Whether the checksum of every file is known."""
        return all(file.sha256 for file in self.files)


def catalogue(file: Path = SHIPPED) -> tuple[Dataset, ...]:
    """The data sets that a catalogue lists. Raises `InputError` for a file that is none."""
    try:
        listed = _read(file)["dataset"]
        found = tuple(_dataset(dict(entry)) for entry in listed)
    except OSError as error:
        raise InputError(
            "unreadable-file", f"the catalogue cannot be read: {error.strerror}.", place=str(file)
        ) from None
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        raise InputError(
            "damaged-file",
            f"this is no catalogue of data sets: {error}.",
            place=str(file),
            fix="write it as the shipped datasets/catalogue.toml is, whose head says what the keys are.",
        ) from None
    names = [dataset.name for dataset in found]
    if bad := [name for name in names if names.count(name) > 1 or Path(name).name != name]:
        said = f"the name {bad[0]!r} is there twice, or cannot be a file's."
        raise InputError("damaged-file", said, place=str(file))
    return found


def _dataset(entry: dict[str, Any]) -> Dataset:
    """Raises `TypeError`, `KeyError`, `ValueError` or `AttributeError` for what a data set may not be."""
    layout = dict(entry.pop("read"))
    columns = tuple(Column(**column) for column in layout.pop("columns"))
    files = tuple(File(**file) for file in entry.pop("file"))
    if not files or not columns:
        raise ValueError("a data set without files or columns")
    read = Layout(columns=columns, **layout)
    for column in columns:
        zero = 0.0 if column.zero == "first" else column.zero
        numbers = (column.scale, zero, column.missing or 0, column.cell, read.cells)
        if not all(isinstance(x, (int, float)) for x in numbers):
            raise ValueError(f"{column.name!r} has text where a number belongs")
        if not 0 <= column.cell < read.cells:
            raise ValueError(f"{column.name!r} has cell {column.cell} of {read.cells}")
    notes = tuple(entry.pop("notes", ()))
    return Dataset(files=files, layout=read, notes=notes, **entry)


def find(name: str, file: Path = SHIPPED) -> Dataset:
    """A data set by its name. Raises `InputError` where there is none of that name."""
    listed = {dataset.name: dataset for dataset in catalogue(file)}
    if name not in listed:
        near = get_close_matches(name, listed, 1, 0.4)
        fix = f"did you mean {near[0]}?" if near else "hysid datasets list names them."
        raise InputError("no-dataset", f"no data set is called {name!r}.", fix=fix)
    return listed[name]


def _read(file: Path) -> dict[str, Any]:
    if file == SHIPPED:  # a list has to come at once
        return tomllib.loads(file.read_text("utf-8"))
    from hysteresis._limits import parse_toml  # late: it loads NumPy

    return parse_toml(file.read_text("utf-8"))


def config_text(dataset: Dataset, seen: Mapping[str, str]) -> str:
    """The TOML for `hysid fit --config`; `seen`: the checksum of each file."""
    lines = [f"# {dataset.what}", f"# {dataset.page}, licence: {dataset.licence or NOT_STATED}"]
    lines += [f"# {dataset.citation}", *(f"# Note: {note}" for note in dataset.notes)]
    lines += [f"# {path} sha256 {sha256}" for path, sha256 in seen.items()]
    lines = [f"# {toml_comment(line[2:])}" for line in lines]
    for table, values in {"selection": dataset.selection, "fit": dataset.fit}.items():
        lines += ["", f"[{table}]"]
        # JSON writes these kinds of values as TOML does.
        lines += [
            f"{key} = {toml_string(v) if isinstance(v, str) else json.dumps(v)}"
            for key, v in values.items()
        ]
    return "\n".join(lines) + "\n"
