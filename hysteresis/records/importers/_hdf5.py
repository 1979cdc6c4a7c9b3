"""Arrays of HDF5 files of strangers: MATLAB 7.3, netCDF.

A data set may say that its values lie in other files (external storage, virtual data sets, links), which
would make any file of the user a column; and a few bytes may declare an array of gigabytes. So a file is
read from memory, a data set is reached by hard links alone, and it is read once its storage is its own and
its size is one that the file can hold.
"""

import io
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from ..._limits import check_shape, most_unpacked


@contextmanager
def opened_hdf5(image: bytes) -> Iterator["Hdf5"]:
    """The arrays of a file's bytes."""
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
