"""What an importer hands on: named columns of cells or arrays, and what there is to say about them."""

import mmap
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches
from itertools import chain
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np

from ..._errors import InputError
from ..._verdict import Note
from .._arrays import MISSING, times
from .._units import bare_unit, is_unit, spelled, written_unit

MOST_FEET = 8
"""Lines below a table: a mean, a deviation, extremes."""

_NUMBER = re.compile(r"[+-]?(\d+([.,]\d*)?|[.,]\d+)([eEdD][+-]?\d+)?|nan", re.IGNORECASE)


class Layout(NamedTuple):
    """How the rows of a text go on below the last one: cells between `separator`, "" for blanks.

    `plain`: they are those of a header and rows, so that empty cells and comments may come too.
    """

    separator: str
    plain: bool


@dataclass(frozen=True)
class Sheet:
    """The columns of a file before anything is made of them.

    **Arguments:**

    - `columns`: the cells of each, by name, all of one length n; numbers where the file has them.
    - `line`: (n,) the line of each row, from 1.
    - `units`: by column, where the file says them beside the header, as the file writes them; "" where it
      says that there is none.
    - `notes`: one for each thing that was done.
    - `decimal`: the sign its numbers are written with.
    - `layout`: how rows would go on, None where more than rows like these may follow.
    - `clock`: the time of the first row and from row to row, in seconds, and what says so.
    """

    columns: Mapping[str, Sequence[str] | np.ndarray]
    line: np.ndarray
    units: Mapping[str, str]
    notes: tuple[Note, ...]
    decimal: str = "."
    layout: Layout | None = None
    clock: tuple[float, float, str] | None = None


def is_number(cell: str) -> bool:
    """Whether a cell is a number, with either decimal sign."""
    return _NUMBER.fullmatch(cell.strip()) is not None


def trimmed(cells: Sequence[str]) -> list[str]:
    """A row without empty cells at its end."""
    end = len(cells)
    while end and not cells[end - 1].strip():
        end -= 1
    return list(cells[:end])


def feet_of(rows: Sequence[Sequence[str]], width: int) -> int:
    """How many of the last rows below a header of so many columns are none.

    Words alone, fewer than the columns: what a program says below its table. Or numbers behind a word, such
    as a mean or a maximum, in a column that holds numbers in all rows above.
    """
    first, labelled = len(rows), False
    while first and len(rows) - first <= MOST_FEET:
        cells = trimmed(rows[first - 1])
        numbers = sum(map(is_number, cells))
        label = cells[0] if numbers and not is_number(cells[0]) else ""
        if numbers and (label.lower() in MISSING or not re.search(r"[^\W\d_]", label)):
            break
        if not numbers and len(cells) >= min(width, 3):
            break
        first, labelled = first - 1, labelled or numbers > 0
    count = len(rows) - first
    # Words in the first column above are labels of rows, not of figures.
    words = labelled and not all(is_number(cell) for row in rows[:first] for cell in row[:1])
    return 0 if words or count > min(MOST_FEET, first) else count


def chosen_table(sizes: Sequence[int], table: int | None) -> int:
    """The place of the largest table, or of the one asked for, from 1. Raises `InputError` `bad-option`."""
    at = int(np.argmax(sizes)) if table is None else table - 1
    if not 0 <= at < len(sizes):
        problem = f"The file has {len(sizes)} tables, and table {table} is asked for."
        raise InputError("bad-option", problem, fix=f"--table 1 to {len(sizes)}.")
    return at


def units_of(cells: Sequence[str]) -> list[str] | None:
    """A row of units as written, one for each cell and "" for none, or None where it is no such row.

    Most of them are known, or all stand in brackets.
    """
    bare = [bare_unit(cell) for cell in cells]
    named = [unit for unit in bare if spelled(unit) != "1"]
    if not named or any(is_number(unit) for unit in named):
        return None
    known = sum(map(is_unit, named))
    bracketed = all(cell.strip()[:1] in "([" for cell in cells if cell.strip())
    return bare if 3 * known >= 2 * len(named) or (bracketed and len(named) > 1) else None


def distinct(names: Sequence[str], taken: Collection[str] = ()) -> list[str]:
    """Names of columns: numbered where empty, with a number behind where there twice."""
    found: list[str] = []
    for k, name in enumerate(names, 1):
        stem = " ".join(name.split()) or f"column {k}"
        other, n = stem, 1
        while other in found or other in taken:
            n += 1
            other = f"{stem} {n}"
        found.append(other)
    return found


def decimal_of(cells: Sequence[str]) -> str:
    """The decimal sign of these cells: a comma where some have one and none has a point."""
    commas = sum("," in cell for cell in cells if is_number(cell))
    return "," if commas and not any("." in cell for cell in cells if is_number(cell)) else "."


class Piece(NamedTuple):
    """A table, or one of several with the same columns.

    Names of columns and their units ("" for none), cells or numbers of each, the line of each row, what
    it is called, the lines within it that are no row, and where it is, for messages.
    """

    header: tuple[str, ...]
    units: tuple[str, ...]
    columns: Sequence[Sequence[str] | np.ndarray]
    line: Sequence[int] | np.ndarray
    label: str = ""
    skipped: Sequence[int] = ()
    place: str = ""


def joined(
    pieces: Sequence[Piece], said: str, column: str, table: int | None = None
) -> Sheet | None:
    """Pieces as one sheet, None without any.

    Those with the same columns are put under one another and told apart by `column`, of others the ones
    with most rows are meant, or `table`. `said`: what they are read as.

    Raises `InputError` `bad-option` where there is no such table.
    """
    families: dict[tuple, list[Piece]] = {}
    for piece in pieces:
        families.setdefault((piece.header, piece.units), []).append(piece)
    # One row of numbers under a line of text is a note, where the file has a table.
    some = [f for f in families.values() if len(f) > 1 or len(f[0].line) > 1]
    listed = some or list(families.values())
    if not listed:
        return None
    sizes = [sum(len(piece.line) for piece in family) for family in listed]
    at = chosen_table(sizes, table)
    chosen = listed[at]
    notes = [Note("format", f"Read as {said.format(line=chosen[0].line[0])}.")]
    if skipped := [k for piece in chosen for k in piece.skipped]:
        left = f"Left out {len(skipped)} lines that are no row, first line {skipped[0]}."
        notes.append(Note("skipped", left))
    joint: list[Any] = [
        np.concatenate(parts) if isinstance(parts[0], np.ndarray) else [*chain(*parts)]
        for parts in zip(*(piece.columns for piece in chosen), strict=True)
    ]
    # Columns without any cell are an end of line in the export, not a measurement.
    kept = [k for k, x in enumerate(joint) if isinstance(x, np.ndarray) or any(x)]
    header, units = chosen[0].header, chosen[0].units
    names = distinct([header[k] for k in kept])
    columns = {name: joint[k] for name, k in zip(names, kept, strict=True)}
    if len(chosen) > 1:
        (name,) = distinct([column], names)
        labels = [piece.label for piece in chosen]
        good = all(labels) and len(set(labels)) == len(labels)
        labels = labels if good else [str(k) for k in range(1, len(labels) + 1)]
        rows = [len(piece.line) for piece in chosen]
        columns = {name: np.repeat(labels, rows)} | columns
        told = f"Put {len(chosen)} tables under one another, told apart by {name!r}."
        notes.append(Note("joined", told))
    if len(listed) > 1:
        others = ", ".join(
            f"{k} ({n} rows {family[0].place})"
            for k, (n, family) in enumerate(zip(sizes, listed, strict=True), 1) if k != at + 1
        )  # fmt: skip
        left = f"Left out {sum(sizes) - sizes[at]} rows of other tables in the file; this is table"
        notes.append(Note("skipped", f"{left} {at + 1}, others are {others}. --table N reads one."))
    # Where a row has units, words in brackets behind a name are not units.
    stated = any(units)
    written = {
        name: units[k] for name, k in zip(names, kept, strict=True)
        if units[k] or (stated and written_unit(header[k], None))
    }  # fmt: skip
    line = np.concatenate([np.asarray(piece.line) for piece in chosen])
    return Sheet(columns, line, written, tuple(notes))


def sheet_of_arrays(
    groups: Mapping[str, Mapping[str, np.ndarray]],
    units: Mapping[str, str],
    said: str,
    table: int | None = None,
) -> Sheet | None:
    """Groups of arrays (n,) of numbers or words as one sheet, None without an array of two values.

    The arrays of the commonest length are the columns of a group; see `joined`. `units`: by the name of an
    array. Arrays of complex numbers, and of bytes as `unread` gives them, are only told.
    """
    pieces, notes = [], []
    for name, given in groups.items():
        arrays = {key: x for key, x in given.items() if x.dtype.kind not in "cS"}
        lengths = [len(x) for x in arrays.values() if len(x) > 1]
        rows = max(lengths, key=lambda n: (lengths.count(n), n), default=0)
        for kind, what in ("c", "of complex numbers"), ("S", "that are text, cells or sparse"):
            here = [k for k, x in given.items() if x.dtype.kind == kind]
            if here := [k for k in here if kind == "c" or len(given[k]) in (0, rows)]:
                left = ", ".join(map(repr, here[:8]))
                notes.append(Note("skipped", f"Left out arrays {what}: {left}."))
        if not lengths:
            continue
        own = {key: x for key, x in arrays.items() if len(x) == rows}
        stamps = {key: times(x) for key, x in own.items() if x.dtype.kind == "M"}
        own |= stamps
        names = {key: units.get(key) or written_unit(key, None) or "" for key in own}
        known = tuple((names | dict.fromkeys(stamps, "s")).values())
        line, place = np.arange(1, rows + 1), f"of {name!r}"
        pieces.append(Piece(tuple(own), known, [*own.values()], line, name, (), place))
        if other := {key: len(x) for key, x in arrays.items() if 1 < len(x) != rows}:
            left = ", ".join(f"{key!r} ({n})" for key, n in list(other.items())[:8])
            notes.append(Note("skipped", f"Left out arrays that have not {rows} values: {left}."))
    sheet = joined(pieces, said, "group", table)
    if sheet is None:
        return None
    rows = np.arange(1, len(sheet.line) + 1)
    return replace(sheet, line=rows, notes=(*sheet.notes, *notes))


# The bytes of a file and its text, or why there are none.
#
# The encoding of a text: by its byte-order mark, as UTF-8, or the likeliest of those that rigs write.

PIECES, PIECE = 8, 2**16
"""Pieces of so many bytes that an excerpt has between head and tail."""
LARGE = 32
"""A text up to so many times the head that is asked for is read whole: an excerpt shows few of its runs."""


MAPPED, _HEAD = 2**25, 2**16
"""Bytes of a text that is not kept in memory, and those that show whether it is one."""
_UFF = re.compile(rb"\s*-1\s")

BAG = b"#ROSBAG V2.0"
"""The first bytes of a ROS bag."""

_MARKS = ((b"\xef\xbb\xbf", "utf-8-sig"), (b"\xff\xfe", "utf-16"), (b"\xfe\xff", "utf-16"))
_BINARY = (
    (b".npy", "save its arrays as text (numpy.savetxt) or as MAT (scipy.io.savemat)."),
    (b"NUMPY", "save its array as text (numpy.savetxt)."),
    (b"PK", "unpack it and give the file that is in it, or export the sheet as CSV."),
    (b"\x1f\x8b", "unpack it (gunzip FILE)."),
    (b"\xd0\xcf\x11\xe0", "export the sheet as CSV."),
)
"""What is in the first bytes of files that are no text, and what to do with them."""
_SINGLE = ("cp1252", "cp1250", "cp1251")
_DOUBLE = ("gb18030", "shift_jis", "big5", "euc_kr")
_NAMES = {
    "cp1252": "Latin-1 (code page 1252)", "cp1250": "code page 1250", "cp1251": "code page 1251",
    "gb18030": "GBK", "shift_jis": "Shift-JIS", "big5": "Big5", "euc_kr": "EUC-KR", "latin-1": "Latin-1",
}  # fmt: skip
_LOOK = 65536
"""Bytes from which the encoding is found."""
_WORDS = re.compile(
    # Words of rigs with a letter that code pages have at different places.
    r"(?i)prüf|länge|höhe|\bµ[a-z]|°c|[(\[]°|±|(?<=m)[²³](?![a-z])|größe|maß|über|für|zähl|gerät|änder|schlüssel|"
    r"déform|déplac|températ|fréq|donnée|résult|éprouv|échant|numéro|mètre|durée|géom|modèle|période|"
    r"posición|tensión|presión|ángulo|força|tração|posição|extensão|velocità|"
    r"obciążenie|próbk|odkształ|naprę|siła|długo|średni|wydłuż|przemie|prędko|síla|napětí|zatížení|čas|dráha|"
    r"erő|idő|feszülts|сила|время|перемещ|нагруз|деформ|напряж|"
    r"时间|載荷|载荷|位移|力|应变|应力|变形|荷重|時間|変位|応力|ひずみ|試験|试验|试样|温度|速度|하중|변위|시간"
)


def mapped(path: Path) -> mmap.mmap | None:
    """A large file that begins as a text does, of which the system reads what is asked for; None of any
    other, and of one that cannot be read."""
    try:
        with path.open("rb") as file:
            head = file.read(_HEAD)
            is_text = b"\0" not in head and b"\n" in head and head[:2] != b"PK"
            if not is_text or _UFF.match(head) or path.stat().st_size < MAPPED:
                return None
            return mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    except OSError:
        return None


def file_bytes(path: Path, most: int | None = None) -> tuple[bytes, int]:
    """What is in a file, and its size.

    `most`: of a text that is `LARGE` times larger, and than head and pieces together, an excerpt in whole
    lines: so many bytes from its head, then pieces from all over it and its tail. Binary files are read
    whole.

    Raises `InputError` `is-directory`, `file-not-found`, `permission-denied`, `unreadable-file`,
    `empty-file`.
    """
    try:
        if (path / "metadata.yaml").is_file():  # a bag of the second ROS is a folder
            parts = sorted(
                one for one in path.iterdir() if one.suffix in (".db3", ".mcap", ".yaml")
            )
            data = BAG + b"".join(one.read_bytes() for one in parts)
            return data, len(data)
        size = path.stat().st_size
        if most is not None and size > max(LARGE * most, most + PIECES * PIECE):
            with path.open("rb") as file:
                data = _excerpt(file, size, most)
        else:
            data = path.read_bytes()
    except IsADirectoryError:
        mend = "give a file that is in it."
        raise fault("is-directory", path, "this is a folder, not a file.", mend) from None
    except (FileNotFoundError, NotADirectoryError):
        folder = path.parent
        names = [p.name for p in folder.iterdir()] if folder.is_dir() else []
        near = ", ".join(get_close_matches(path.name, names, 3, 0.3)) or "nothing alike"
        where = f"nearest: {near}." if folder.is_dir() else "its folder does not exist."
        mend = "give the path of a file that exists, from the current folder or from the root."
        raise fault("file-not-found", path, f"not found; {where}", mend) from None
    except PermissionError:
        raise fault("permission-denied", path, "you may not read it.", "chmod +r FILE.") from None
    except OSError as error:
        problem = f"cannot be read: {error.strerror}."
        raise fault("unreadable-file", path, problem, "copy the file and read the copy.") from None
    if not data.strip():
        raise fault("empty-file", path, "the file is empty.", "export the data again.")
    return data, size


def _excerpt(file: BinaryIO, size: int, most: int) -> bytes:
    head = file.read(most)
    if b"\0" in head or b"\n" not in head or head[:2] == b"PK":
        return head + file.read()
    found = [head[: head.rindex(b"\n") + 1]]
    for at in np.linspace(most, size - PIECE, PIECES, dtype=int).tolist():
        file.seek(at)
        piece = file.read(PIECE)
        begin, end = piece.find(b"\n") + 1, piece.rfind(b"\n") + 1
        found.append(piece[begin:] if at + PIECE >= size else piece[begin:end])
    return b"".join(found)


def fault(code: str, path: Path, problem: str, fix: str = "") -> InputError:
    """An error that concerns the whole file."""
    return InputError(code, problem, place=str(path), fix=fix)


def decode(path: Path, data: bytes) -> tuple[str, list[Note]]:
    """The text, and what is to be noted about it. Raises `InputError` `binary-file`."""
    for mark, name in _MARKS:
        if data.startswith(mark):
            notes = [Note("encoding", "Decoded as UTF-16.")] if name == "utf-16" else []
            return data.decode(name, "replace"), notes
    if wide := _unmarked_utf16(data):
        said = "Decoded as UTF-16, likely: every other byte is zero."
        return data.decode(wide, "replace"), [Note("encoding-guessed", said)]
    if b"\0" in data or data[:4] in (b"PK\x03\x04", b"\x1f\x8b\x08\x00"):
        mend = next((mend for mark, mend in _BINARY if mark in data[:64]), "export it as text.")
        raise fault("binary-file", path, "this is no text but binary data.", mend)
    try:
        return data.decode("utf-8"), []
    except UnicodeDecodeError:
        name = _likeliest(data[:_LOOK])
        said = f"Decoded as {_NAMES[name]}, likely: it is not UTF-8."
        return data.decode(name, "replace"), [Note("encoding-guessed", said)]


def _unmarked_utf16(data: bytes) -> str:
    """UTF-16 without a mark: every other byte of Latin text is zero."""
    head = data[:4096]
    half = len(head) // 2
    if half >= 8:
        for at, name in ((1, "utf-16-le"), (0, "utf-16-be")):
            if head[at::2].count(0) > 0.9 * half and head[1 - at :: 2].count(0) == 0:
                return name
    return ""


def _likeliest(data: bytes) -> str:
    """The encoding in which the bytes above ASCII make most letters of words that rigs write.

    Where there is no such word, Latin-1.
    """
    scores: dict[str, tuple[int, int]] = {}
    for name in (*_SINGLE, *_DOUBLE):
        try:
            text = data.decode(name)
        except UnicodeDecodeError as error:
            if error.start < len(data) - 4:  # else the look ends within a character
                continue
            text = data[: error.start].decode(name)
        words = [word for word in _WORDS.findall(text) if not word.isascii()]
        odd = sum(not character.isascii() for character in text)
        scores[name] = sum(map(len, words)), -odd
    if any(known for known, _ in scores.values()):
        return max(scores, key=lambda name: scores[name])
    return "cp1252" if "cp1252" in scores else "latin-1"
