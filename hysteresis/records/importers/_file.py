"""The bytes of a file and its text, or why there are none.

The encoding of a text: by its byte-order mark, as UTF-8, or the likeliest of those that rigs write.
"""

import mmap
import re
from difflib import get_close_matches
from pathlib import Path
from typing import BinaryIO

import numpy as np

from ..._errors import InputError
from ..._note import Note

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
