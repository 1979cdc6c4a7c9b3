"""Reading files of strangers within limits: size, nesting and number, before anything is unpacked.

Every function raises `ValueError`, whose message names the limit; `damage_told` says which file it was.
"""

import json
import re
import struct
import tokenize
import tomllib
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from ._errors import InputError

LARGEST_JSON, LARGEST_TOML = 256_000_000, 1_000_000
"""Bytes of a document."""
DEEPEST = 64
"""Levels of nesting, and parts of a key with dots."""
ALWAYS_UNPACKED, LARGEST_RATIO, LARGEST_UNPACKED = 256_000_000, 50, 16_000_000_000
"""Bytes that a packed file may always unpack to; beyond, how many times its own size, and the end of it."""

DAMAGE: tuple[type[Exception], ...] = (
    ArithmeticError, AttributeError, EOFError, LookupError, MemoryError, OSError, RuntimeError,
    TypeError, ValueError, struct.error, zipfile.BadZipFile, zlib.error,
)  # fmt: skip
"""What readers of arrays, HDF5 and JSON raise where a file was damaged or made up."""

_MARKS = re.compile(r'"(?:[^"\\]|\\.)*"|[\[\]{}]')
_TOML_TEXT = re.compile(
    r'"""(?:[^\\]|\\.)*?"""|\'\'\'.*?\'\'\'|"(?:[^"\\\n]|\\.)*"|\'[^\'\n]*\'|#[^\n]*', re.DOTALL
)
_NO_KEY = re.compile(r"[=,\[\]{}\n]")


@contextmanager
def damage_told(name: str, place: Path, fix: str) -> Iterator[None]:
    """What readers raise of a damaged file, as an `InputError` `damaged-file`; others pass."""
    try:
        yield
    except InputError:
        raise
    except DAMAGE as error:
        plain = isinstance(error, OSError | ValueError) and str(error)
        said = (plain or f"{type(error).__name__} {error}").splitlines()[0]
        raise InputError(
            "damaged-file",
            f"{name} cannot be used: {said}.",
            place=str(place),
            cause="It was cut off or edited, or another version wrote it.",
            fix=fix,
        ) from error


def parse_json(raw: str | bytes) -> Any:
    """A JSON document, at most `DEEPEST` deep."""
    if len(raw) > LARGEST_JSON:
        raise ValueError(f"it has {len(raw):,} bytes, and the limit is {LARGEST_JSON:,}")
    text = raw.decode("utf-8") if isinstance(raw, bytes) else raw
    if text.count("[") + text.count("{") > DEEPEST:
        _check_depth(_MARKS.findall(text))
    return json.loads(text, parse_constant=_no_number)


def _no_number(said: str) -> None:
    raise ValueError(f"{said} is not JSON")


def parse_toml(text: str) -> dict[str, Any]:
    """A TOML document, at most `DEEPEST` deep, its keys too."""
    if len(text) > LARGEST_TOML:
        raise ValueError(f"it has {len(text):,} characters, and the limit is {LARGEST_TOML:,}")
    bare = _TOML_TEXT.sub("", text)
    _check_depth(re.findall(r"[\[\]{}]", bare))
    if max((key.count(".") for key in _NO_KEY.split(bare)), default=0) >= DEEPEST:
        raise ValueError(f"a key has more than {DEEPEST} parts")
    return tomllib.loads(text)


def _check_depth(marks: list[str]) -> None:
    depth = 0
    for mark in marks:
        depth += (mark in "[{") - (mark in "]}")
        if depth > DEEPEST:
            raise ValueError(f"it is nested more than {DEEPEST} deep")


def load_arrays(file: Path | BytesIO) -> dict[str, np.ndarray]:
    """The arrays of a .npz file; no object among them, and no more than what the file holds."""
    with zipfile.ZipFile(file) as packed:
        check_packed(packed)
        return {m.filename.removesuffix(".npy"): _array(packed, m) for m in packed.infolist()}


def most_unpacked(size: int) -> int:
    """Bytes that so many packed ones may unpack to."""
    return max(ALWAYS_UNPACKED, LARGEST_RATIO * size)


def check_packed(packed: zipfile.ZipFile) -> None:
    """Raise `ValueError` where a zip file would unpack to more than its size explains."""
    members = packed.infolist()
    held, unpacked = sum(m.compress_size for m in members), sum(m.file_size for m in members)
    most = min(most_unpacked(held), LARGEST_UNPACKED)
    if unpacked > most:
        raise ValueError(
            f"it would unpack to {unpacked:,} bytes, and the limit for {held:,} packed ones is {most:,}"
        )


def _array(packed: zipfile.ZipFile, member: zipfile.ZipInfo) -> np.ndarray:
    # Other ways are unpacked without bounds.
    if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise ValueError(f"{member.filename} is packed in an unusual way")
    form = np.lib.format
    versions = {(1, 0): form.read_array_header_1_0, (2, 0): form.read_array_header_2_0}
    with packed.open(member) as opened:
        if (read := versions.get(version := form.read_magic(opened))) is None:
            raise ValueError(f"{member.filename} has version {version} of the format")
        try:
            shape, by_column, dtype = read(opened)
        except (SyntaxError, tokenize.TokenError) as error:  # as NumPy reads headers of Python 2
            raise ValueError(f"the header of {member.filename} cannot be read: {error}") from None
        check_shape(shape, dtype, member.file_size)
        content = opened.read(member.file_size + 1)  # without a limit the whole of it is unpacked
    array = np.frombuffer(content, dtype, count=int(np.prod(shape, dtype=object)))
    return array.reshape(shape, order="F" if by_column else "C").copy()


def check_shape(shape: tuple[int, ...], dtype: np.dtype, held: int) -> None:
    """Raise `ValueError` for objects, and for an array of more bytes than are `held` for it."""
    if dtype.hasobject:
        raise ValueError("it holds objects, which are never read")
    declared = int(np.prod(shape, dtype=object)) * dtype.itemsize
    if declared > held or min(shape, default=0) < 0:
        raise ValueError(f"an array declares {declared:,} bytes, and the file holds {held:,} of it")
