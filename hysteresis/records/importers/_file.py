"""The bytes of a file and its text, or why there are none."""

import mmap
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


MAPPED, _HEAD = 2**25, 2**16
"""Bytes of a text that is not kept in memory, and those that show whether it is one."""
_UFF = re.compile(rb"\s*-1\s")

BAG = b"#ROSBAG V2.0"
"""The first bytes of a ROS bag."""


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
