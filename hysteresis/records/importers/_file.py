"""The bytes of a file and its text, or why there are none."""

import hashlib
import os
import re
from difflib import get_close_matches
from pathlib import Path
from typing import BinaryIO

import numpy as np

from ..._errors import InputError

PIECES, PIECE = 8, 2**16
"""Pieces of so many bytes that an excerpt has between head and tail."""
LARGE = 32
"""A text up to so many times the head that is asked for is read whole: an excerpt shows few of its runs."""


STREAMED, _HEAD = 2**25, 2**16
"""Bytes of a text that is not kept in memory, and those that show whether it is one."""
_UFF = re.compile(rb"\s*-1\s")

BAG = b"#ROSBAG V2.0"
"""The first bytes of a ROS bag."""


class Streamed:
    """The bytes of a large text, of which a piece at a time is in memory."""

    def __init__(self, path: Path):
        self._path = path.absolute()  # the current folder may be another one later
        self._state = self._now()

    def __len__(self) -> int:
        return self._state.st_size

    def __getitem__(self, place: slice) -> bytes:
        begin, end, _ = place.indices(len(self))
        now = self._now()
        if (now.st_size, now.st_mtime_ns) != (self._state.st_size, self._state.st_mtime_ns):
            raise fault(
                "unreadable-file", self._path, "it was changed while it was read.", "try again."
            )
        with self._path.open("rb") as file:
            file.seek(begin)
            return file.read(end - begin)

    def rfind(self, part: bytes, begin: int, end: int) -> int:
        """As of bytes, within a piece."""
        at = self[begin:end].rfind(part)
        return at if at < 0 else at + begin

    def sha256(self) -> str:
        """Of the whole file."""
        with self._path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()

    def _now(self) -> os.stat_result:
        return self._path.stat()


def streamed(path: Path) -> Streamed | None:
    """A large file that begins as a text does; None of any other, and of one that cannot be read."""
    try:
        if not path.is_file() or path.stat().st_size < STREAMED:
            return None
        found = Streamed(path)
        head = found[:_HEAD]
    except OSError:
        return None
    is_text = b"\0" not in head and b"\n" in head and head[:2] != b"PK" and not _UFF.match(head)
    return found if is_text else None


def file_bytes(path: Path, most: int | None = None) -> tuple[bytes, int]:
    """What is in a file, and its size.

    `most`: of a text that is `LARGE` times larger, an excerpt in whole lines: so many bytes from its head,
    then pieces from all over it and its tail. Binary files are read whole.

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
        if most is not None and size > LARGE * most:
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
