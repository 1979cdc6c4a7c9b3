"""Measured data of third parties: a list of where they are, and fetching one of them as a tidy CSV."""

import csv
import hashlib
import io
import json
import logging
import tempfile
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Any, Literal, NamedTuple
from urllib.parse import quote

from hysteresis import InputError
from hysteresis._escape import toml_comment, toml_string
from hysteresis._files import write_whole

from ._packages import check_extra

_WHEEL = Path(__file__).parent / "catalogue.toml"
_CHECKOUT = Path(__file__).resolve().parents[1] / "datasets" / "catalogue.toml"
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


def fetch(
    dataset: Dataset,
    out: Path,
    *,
    accept: bool = False,
    overwrite: bool = False,
    say: Callable[[str], None] = lambda _: None,
) -> dict[str, Any]:
    """Write `out`/NAME.csv and `out`/NAME.toml, which `hysid fit --config` takes.

    **Arguments:**

    - `accept`: take files whose checksum the catalogue does not know.
    - `overwrite`: write over files that are there.

    **Raises:** `InputError` `missing-extra`, `would-overwrite`, `no-download`, `wrong-checksum`,
    `unknown-checksum`; nothing is written then.
    """
    check_extra("datasets", "pooch")
    table, config = out / f"{dataset.name}.csv", out / f"{dataset.name}.toml"
    for file in (table, config):
        if file.exists() and not overwrite:
            said = "this file is there already, and was left as it is."
            fix = "name another folder (--out DIR), or write over it (--overwrite)."
            raise InputError("would-overwrite", said, place=str(file), fix=fix)
    seen: dict[str, dict[str, Any]] = {}
    texts = {}
    for file in dataset.files:
        address = dataset.base + quote(file.path)
        say(f"fetching {address}")
        content = _download(address)
        seen[file.path] = {"sha256": hashlib.sha256(content).hexdigest(), "bytes": len(content)}
        _check(file, address, **seen[file.path])
        texts[file] = content.decode("utf-8-sig", "replace")
    if (unknown := [file.path for file in dataset.files if not file.sha256]) and not accept:
        checksums = "; ".join(f"{path} has {seen[path]['sha256']}" for path in unknown)
        raise InputError(
            "unknown-checksum",
            f"the catalogue does not know the sha256 of {len(unknown)} of the files: {checksums}.",
            place=dataset.name,
            cause="nobody has checked these files yet; their sizes are as listed.",
            fix="compare with a source you trust, then say --accept; the checksums go into the TOML.",
        )
    written, rows = _table(dataset, texts)
    write_whole(
        config, config_text(dataset, {path: found["sha256"] for path, found in seen.items()})
    )
    write_whole(table, written)
    return {
        "name": dataset.name, "file": str(table), "config": str(config), "rows": rows,
        "sources": [{"path": path, **found} for path, found in seen.items()], "checked": not unknown,
        "licence": dataset.licence or None, "citation": dataset.citation, "notes": list(dataset.notes),
    }  # fmt: skip


def _download(address: str) -> bytes:
    import pooch

    # It tells of every download, with a checksum to copy: what we say ourselves.
    pooch.get_logger().setLevel(logging.WARNING)
    with tempfile.TemporaryDirectory(prefix="hysid-") as folder:
        try:
            return Path(pooch.retrieve(address, None, "download", folder)).read_bytes()
        except (OSError, ValueError) as error:
            raise InputError(
                "no-download",
                f"this cannot be fetched ({type(error).__name__}: {error}).",
                place=address,
                cause="no network, a proxy, or the file was taken away.",
            ) from None


def _check(file: File, address: str, sha256: str, bytes: int) -> None:
    said = cause = ""
    if file.sha256 and sha256 != file.sha256.lower():
        said = f"what came has sha256 {sha256}, and the catalogue says {file.sha256}."
        cause = "the file was changed, or the download was tampered with or cut off."
    elif file.bytes and bytes != file.bytes:
        said = f"what came has {bytes} bytes, and the catalogue says {file.bytes}."
        cause = "a download that was cut off, or a page that says why there is no file."
    if said:
        raise InputError("wrong-checksum", said, place=address, cause=cause)


def _table(dataset: Dataset, texts: dict[File, str]) -> tuple[str, int]:
    """The CSV of all files, and its number of rows."""
    layout, several = dataset.layout, len(dataset.files) > 1
    header = [column.name for column in layout.columns]
    head = ["file"] * several + [layout.blocks] * bool(layout.blocks)
    page = io.StringIO()
    writer = csv.writer(page, lineterminator="\n")
    writer.writerow([*head, *header])
    rows = 0
    for file, text in texts.items():
        blocks = _blocks(layout, text, file.path)
        samples = [cells for block in blocks for cells in block]
        numbers = [str(k) for k, block in enumerate(blocks) for _ in block]
        columns = [_column(c, [cells[c.cell] for cells in samples]) for c in layout.columns]
        for number, *values in zip(numbers, *columns, strict=True):
            own = [file.label or file.path] * several + [number] * bool(layout.blocks)
            writer.writerow([*own, *values])
        rows += len(samples)
    return page.getvalue(), rows


def _blocks(layout: Layout, text: str, place: str) -> list[list[list[str]]]:
    """The cells of the samples, by blocks; those of one line are none where blocks are numbered.

    Raises `InputError` `wrong-checksum` without samples, and for a line amid them that is none.
    """
    blocks: list[list[list[str]]] = []
    within, odd = False, 0
    for number, line in enumerate(text.splitlines(), 1):
        cells = line.split()
        if layout.separator:
            row = next(csv.reader([line], delimiter=layout.separator), [])
            cells = [cell.strip() for cell in row]
        if len(cells) != layout.cells or not all(_is_number(cells[c.cell]) for c in layout.columns):
            within = False
            odd = odd or (number if blocks and line.strip() else 0)
            continue
        if odd:
            raise _not_as_listed(f"line {odd} is no sample, and samples follow it", place)
        if not within:
            blocks.append([])
        blocks[-1].append(cells)
        within = True
    if layout.blocks:
        blocks = [block for block in blocks if len(block) > 1]
    if not blocks:
        raise _not_as_listed(f"no line has {layout.cells} cells with numbers where wanted", place)
    return blocks


def _column(column: Column, cells: list[str]) -> list[str]:
    """Numbers as the file has them where nothing is done to them."""
    if column.missing is not None:
        cells = ["" if float(cell) == column.missing else cell for cell in cells]
    if column.scale == 1 and column.zero == 0:
        return cells
    zero = float(next(filter(None, cells), 0)) if column.zero == "first" else float(column.zero)
    moved = ((column.scale * (float(cell) - zero)) if cell else None for cell in cells)
    return ["" if x is None else f"{x + 0.0:.10g}" for x in moved]


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _not_as_listed(what: str, place: str) -> InputError:
    return InputError(
        "wrong-checksum",
        f"{what}.",
        place=place,
        cause="the file is laid out otherwise than the catalogue says.",
        fix="mend [dataset.read] of the catalogue, and name it: --catalogue FILE.",
    )


SYNTHETIC = frozenset((
    "73aa42d5626d0b9d89d55be2a8f3cfb06c3050d592b79b1dd8b0f2810ba762f4",  # armor-presses.csv
    "9e62212d15c0bc1109576c384fa7822e75e7a670fcb7c18198a3422375577d4b",  # armor-wrenches.csv
    "edbecde0087e26e43cd59bbfa60cad8fdb3178b50f91f52d839116513f6eaa63",  # skin-one-place.csv
    "e237d675f514fd4202a0d7552a0fecfebd53b0bf2092aa45f3573d97e5902857",  # skin-two-places.csv
    "ca462c13db4e49025a0bf12b77082fa791af911827fb8ab0b14113fcb27eaf26",  # sponge-10mm-cycles.csv
    "56441275887d8ad2eeba79839b6c6ac13a64dba34f4a14275095d60bdbdcdaa8",  # sponge-30mm-cycles.csv
    "871c16b8fbe86f2146f38d64ce3d055ee155f8aafa0bc19c0a9f443a7da88c39",  # sponge-50mm-cycles.csv
    "d84bdb5530d7463e5616cb650759d7ba5d05c650de6ea588491ff6ec7842cc39",  # sponge-50mm-minor-loops.csv
    "41eb7741a4f666029c4b794db2a0d952f53e1baa1088695d163708fc0e00f7bf",  # sponge-50mm-mixed-cycles.csv
))  # fmt: skip
"""SHA-256 of each; `python -m benchmarks.datasets` writes the files."""


def is_synthetic(sha256: str | None) -> bool:
    """Whether a file with this checksum was made by a virtual rig of ours."""
    return sha256 in SYNTHETIC
