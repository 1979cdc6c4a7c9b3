"""The table of a file that is not a text of rows: the first reader that knows its first bytes."""

from collections.abc import Callable
from pathlib import Path

from ._excel import workbook
from ._matlab import arrays_file
from ._parquet import parquet
from ._ros_bag import ros_bag
from ._sheet import Sheet
from ._tdms import tdms
from ._uff import universal_file

_READERS: tuple[Callable[[Path, bytes, int | None], Sheet | None], ...] = (
    tdms, workbook, arrays_file, parquet, ros_bag, universal_file,
)  # fmt: skip


def binary(path: Path, data: bytes, table: int | None = None) -> Sheet | None:
    """The table of such a file, None where it is a text of rows or of a kind that no reader knows."""
    return next((sheet for read in _READERS if (sheet := read(path, data, table))), None)
