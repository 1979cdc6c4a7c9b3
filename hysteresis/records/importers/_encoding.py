"""The encoding of a text: by its byte-order mark, as UTF-8, or the likeliest of those that rigs write."""

import re
from pathlib import Path

from ..._note import Note
from ._file import fault

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
