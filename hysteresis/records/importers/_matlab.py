"""MATLAB's .mat files: versions 5 to 7.2 through SciPy, 7.3 through h5py. HDF5 files alike."""

import io
import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from ..._limits import check_shape, load_arrays, most_unpacked
from ._apart import read_apart
from ._matlab_arrays import unread, vectors
from ._sheet import Sheet, sheet_of_arrays


@contextmanager
def opened_hdf5(image: bytes) -> Iterator["Hdf5"]:
    """The arrays of a file's bytes.

    A data set may say that its values lie in other files (external storage, virtual data sets, links),
    which would make any file of the user a column; and a few bytes may declare gigabytes. So a file is read
    from memory, a data set is reached by hard links alone, and it is read once its storage is its own and
    its size is one that the file can hold.
    """
    import h5py  # a quarter of a second, for this alone

    with h5py.File(io.BytesIO(image), "r") as file:
        yield Hdf5(file, len(image))


class Hdf5:
    """An open file; all that is read of it together is bounded by its size in bytes."""

    def __init__(self, file: Any, size: int):
        self.file = file
        self.left = most_unpacked(size)

    def array(self, path: str) -> np.ndarray:
        """A data set. Raises `ValueError` where it is none, lies elsewhere, holds objects or is too large,
        and `KeyError` where nothing has this name."""
        import h5py

        node: Any = self.file
        for name in path.split("/"):
            link = node.get(name, getlink=True)
            if link is not None and not isinstance(link, h5py.HardLink):
                raise ValueError(f"{path} is a link, and links are not followed")
            node = node[name]
        if not isinstance(node, h5py.Dataset):
            raise ValueError(f"{path} is no array")
        if node.external or node.is_virtual:
            raise ValueError(f"the values of {path} lie in other files, which are not read")
        check_shape(node.shape, node.dtype, self.left)
        self.left -= node.size * node.dtype.itemsize
        return np.asarray(node[()])


_MATLAB, _HDF5 = b"MATLAB 5.0 MAT-file", b"\x89HDF\r\n\x1a\n"


def is_arrays_file(data: bytes) -> bool:
    """Whether bytes are those of a .mat or an HDF5 file."""
    old = data.startswith(_MATLAB) and b"MAT-file" in data[:116] and data[124:128] != b"\0\0\0\0"
    return old or _is_hdf5(data)


def _is_hdf5(data: bytes) -> bool:
    return _HDF5 in (data[:8], data[512:520])  # 7.3 begins with 512 bytes of text


def arrays_file(path: Path, data: bytes, table: int | None = None) -> Sheet | None:
    """The table of a .mat or HDF5 file, None without a vector.

    Vectors are columns, by the names of variables, of the fields of a structure or of data sets, or by the
    name that a structure holds beside its values; a matrix of few columns is one column each, named by a
    list of as many words beside it. Structures and groups with the same vectors are put under one another
    and told apart by the column "group". Units are attributes `units` or `unit` of data sets.
    """
    units: dict[str, str] = {}
    groups = dict((_hdf5 if _is_hdf5(data) else _matlab)(data, units))
    return sheet_of_arrays(groups, units, "a file of arrays", table=table)


def _matlab(data: bytes, units: dict[str, str]) -> Iterator[tuple[str, dict[str, np.ndarray]]]:
    arrays = load_arrays(io.BytesIO(read_apart("_matlab_arrays", data)))
    said = json.loads(arrays.pop("said").tobytes())
    units |= said["units"]
    for name, keys in said["groups"].items():
        yield name, {key: arrays.pop(next(iter(arrays))) for key in keys}


def _unpacked(x: np.ndarray, told: Mapping[str, Any]) -> np.ndarray:
    """Numbers as netCDF packs them: scale_factor x + add_offset, NaN where x is _FillValue."""
    packed = {"scale_factor", "add_offset", "_FillValue"} & {*told}
    if not packed or x.dtype.kind not in "iuf":
        return x
    scale, offset, fill = (
        float(np.ravel(told.get(name, usual))[0])
        for name, usual in (("scale_factor", 1.0), ("add_offset", 0.0), ("_FillValue", np.nan))
    )
    return np.where(x == fill, np.nan, scale * x + offset)


def _hdf5(data: bytes, units: dict[str, str]) -> Iterator[tuple[str, dict[str, np.ndarray]]]:
    import h5py  # a quarter of a second, for this alone

    with opened_hdf5(data) as own:
        turned = data[:6] == b"MATLAB"  # which writes a column as a row
        groups: dict[str, dict[str, np.ndarray]] = {}

        def visit(path: str, node: Any) -> None:
            if not isinstance(node, h5py.Dataset) or path.startswith("#"):
                return
            kind = node.dtype.kind
            if node.shape is None or node.attrs.get("MATLAB_class") == b"char":
                return
            name, _, key = path.rpartition("/")
            if kind not in "biufcV" or node.dtype.hasobject:
                found = vectors(key, unread(node.shape))
            else:
                x = own.array(path)
                found = vectors(key, _unpacked(x.T if turned else x, node.attrs))
            groups.setdefault(name.replace("/", "."), {}).update(found)
            for attribute in ("units", "unit", "Units", "Unit"):
                unit = node.attrs.get(attribute)
                if unit is not None:
                    text = unit.decode() if isinstance(unit, bytes) else str(unit)
                    # netCDF: hours since 2026-01-01
                    units.update(dict.fromkeys(found, text.partition(" since ")[0]))

        own.file.visititems(visit)
        yield from groups.items()
