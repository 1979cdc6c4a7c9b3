"""The structure of a MAT-file of version 5 to 7.2, checked because damage crashes SciPy's reader.

Format: MathWorks, "MAT-File Format", 2018, chapter 1: elements of a type, a length and data, within one
another.
"""

import struct
import zlib
from collections.abc import Iterator

from ..._limits import most_unpacked

_HEADER, _MATRIX, _COMPRESSED, _INT8, _INT32, _UINT32 = 128, 14, 15, 1, 5, 6
_SIZE = {1: 1, 2: 1, 3: 2, 4: 2, 5: 4, 6: 4, 7: 4, 9: 8, 12: 8, 13: 8}
"""Bytes of a number, by its type."""
_TEXT = (*_SIZE, 16, 17, 18)
_CELL, _STRUCT, _OBJECT, _CHAR, _SPARSE, _NUMBERS, _COMPLEX = 1, 2, 3, 4, 5, range(6, 16), 0x0800
_DEEPEST = 16

Element = tuple[int, bytes]


def checked_matlab(data: bytes) -> bytes:
    """The header and those variables that are whole and plain; others, such as tables, are left out.

    Raises `ValueError` where an element does not fit into the one that holds it.
    """
    order = {b"IM": "<", b"MI": ">"}.get(data[126:128])
    if order is None:
        raise ValueError("its order of bytes is not known")
    at, kept, unpacked = _HEADER, [data[:_HEADER]], 0
    while at < len(data):
        kind, length = struct.unpack_from(f"{order}II", data, at)
        end = at + 8 + length
        if end > len(data) or kind not in (_MATRIX, _COMPRESSED):
            raise ValueError("a variable is cut off, or is none")
        body = data[at + 8 : end]
        if kind == _COMPRESSED:
            most = most_unpacked(len(data)) - unpacked
            opened = zlib.decompressobj()
            whole = opened.decompress(body, max(most, 1))
            if opened.unconsumed_tail or len(whole) < 8:
                raise ValueError(f"it would unpack to more than {most:,} bytes, or to nothing")
            unpacked += len(whole)
            kind, length = struct.unpack_from(f"{order}II", whole)
            body = whole[8:]
            if kind != _MATRIX or length != len(body):
                raise ValueError("a compressed variable is none")
        if _is_plain(body, order, 0):
            kept.append(data[at:end])
        at = end
    return b"".join(kept)


def _is_plain(body: bytes, order: str, depth: int) -> bool:
    """Whether a matrix is one that SciPy reads; raises `ValueError` where it is damaged."""
    if not body:
        return depth > 0
    if depth > _DEEPEST:
        raise ValueError(f"its cells are nested more than {_DEEPEST} deep")
    parts = _elements(body, order)
    flags, what = _next(parts, _UINT32), 0
    if len(flags) != 8:
        raise ValueError("an array has no flags")
    what = struct.unpack(f"{order}I", flags[:4])[0]
    known = what & 0xFF
    if known not in (_CELL, _STRUCT, _OBJECT, _CHAR, _SPARSE, *_NUMBERS):
        return False
    sizes = _next(parts, _INT32)
    if len(sizes) < 8 or len(sizes) % 4:
        raise ValueError("an array has no dimensions")
    count = 1
    for size in struct.unpack(f"{order}{len(sizes) // 4}i", sizes):
        count *= size
        if size < 0 or count > 2**40:
            raise ValueError("an array has impossible dimensions")
    _next(parts, _INT8)
    if known in (_CELL, _STRUCT, _OBJECT):
        return _holds(parts, known, count, order, depth)
    if known == _SPARSE:
        return False
    for _ in range(1 + bool(what & _COMPLEX and known != _CHAR)):
        kind, values = next(parts, (0, b""))
        size = _SIZE.get(kind, 0)
        if known == _CHAR:
            if kind not in _TEXT or (size and len(values) != count * size):
                return False
        elif not size or len(values) != count * size:
            raise ValueError(f"an array of {count:,} numbers has {len(values):,} bytes")
    return known != _CHAR or kind in (2, 4, 16)


def _holds(parts: Iterator[Element], known: int, count: int, order: str, depth: int) -> bool:
    """Cells, or the fields of a structure: each is a matrix."""
    if known == _OBJECT:
        _next(parts, _INT8)
    if known != _CELL:
        length = _next(parts, _INT32)
        names = _next(parts, _INT8)
        width = struct.unpack(f"{order}i", length)[0] if len(length) == 4 else 0
        if width < 1 or len(names) % width:
            raise ValueError("the names of a structure's fields do not fit")
        count *= len(names) // width
    found = 0
    for kind, body in parts:
        found += 1
        if kind != _MATRIX or not _is_plain(body, order, depth + 1):
            return False
    if found != count:
        raise ValueError(f"a structure of {count:,} parts has {found:,}")
    return True


def _next(parts: Iterator[Element], wanted: int) -> bytes:
    kind, body = next(parts, (0, b""))
    if kind != wanted:
        raise ValueError("an array's parts are not in order")
    return body


def _elements(body: bytes, order: str) -> Iterator[Element]:
    """The elements within a matrix, one after the other, each filled up to eight bytes."""
    at = 0
    while at < len(body):
        if at + 8 > len(body):
            raise ValueError("an element is cut off")
        kind, length = struct.unpack_from(f"{order}II", body, at)
        if kind >> 16:  # four bytes and less are in the tag itself
            kind, length = kind & 0xFFFF, kind >> 16
            if length > 4:
                raise ValueError("a small element is too large")
            yield kind, body[at + 4 : at + 4 + length]
            at += 8
            continue
        if at + 8 + length > len(body):
            raise ValueError("an element is cut off")
        yield kind, body[at + 8 : at + 8 + length]
        at += 8 + -(-length // 8) * 8
