"""The table of a file that is not a text of rows: the first reader that knows its first bytes."""

import importlib.util
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from ..._errors import InputError
from ._extras import PARQUET, TDMS, is_workbook, parquet, tdms, workbook
from ._file import BAG, fault
from ._matlab import arrays_file, is_arrays_file
from ._ros_bag import ros_bag
from ._sheet import Sheet
from ._uff import BEGINS, universal_file


class _Reader(NamedTuple):
    """Files of one kind: what they are called, whether bytes are one, and what makes a table of them.

    - `none`, `fix`: what is said of one without a table.
    - `package`, `extra`: what has to be installed for it, if anything; `instead`: how to do without.
    """

    what: str
    knows: Callable[[bytes], bool]
    read: Callable[[Path, bytes, int | None], Sheet | None]
    none: str
    fix: str = ""
    package: str = ""
    extra: str = ""
    instead: str = ""


_READERS = (
    _Reader(
        "TDMS file", lambda data: data[:4] == TDMS, tdms, "no channel holds numbers.",
        package="npTDMS", extra="rigs", instead="export the file as text (.lvm, .csv)",
    ),
    _Reader(
        "workbook", is_workbook, workbook, "no sheet holds a table: a header and rows of numbers.",
        package="python-calamine", extra="rigs", instead="export the sheet as CSV",
    ),
    _Reader(
        "file of arrays", is_arrays_file, arrays_file,
        "it holds no vector of numbers; tables and time series of MATLAB are objects of its own.",
        "save them as vectors: s = table2struct(T, 'ToScalar', true).",
    ),
    _Reader(
        "Parquet file", lambda data: data[:4] == data[-4:] == PARQUET, parquet, "a header and no rows.",
        package="pyarrow", extra="parquet", instead="export the table as CSV",
    ),
    _Reader(
        "ROS bag", lambda data: data.startswith(BAG), ros_bag, "no topic holds numbers.",
        package="rosbags", extra="ros",
        instead="print the topics as CSV (rostopic echo -b FILE -p TOPIC)",
    ),
    _Reader(
        "UFF file", lambda data: BEGINS.match(data[:400]) is not None, universal_file,
        "this is a UFF file without a record over time: values over frequency, or no data set 58.",
        "export values over time.",
    ),
)  # fmt: skip


def binary(path: Path, data: bytes, table: int | None = None) -> Sheet | None:
    """The table of such a file, None where it is a text of rows or of a kind that no reader knows.

    `table`: which of several tables, from 1.

    Raises `InputError` `missing-extra`, `damaged-file`, `no-rows`, and `bad-option` without such a table.
    """
    reader = next((one for one in _READERS if one.knows(data)), None)
    if reader is None:
        return None
    what, module = reader.what, reader.package.lower().replace("-", "_")
    if module and importlib.util.find_spec(module) is None:
        raise fault(
            "missing-extra", path, f"{what}s are read by {reader.package}, which is not installed.",
            f"pip install 'hysid[{reader.extra}]', or {reader.instead}.",
        )  # fmt: skip
    try:
        sheet = reader.read(path, data, table)
    except (KeyboardInterrupt, SystemExit, GeneratorExit, InputError):
        raise
    except BaseException as error:  # whatever readers meet, and a panic of Rust is no `Exception`
        error.__traceback__ = None  # an object of HDF5 in its frames must not outlive the library
        raise fault("damaged-file", path, f"this {what} is damaged: {error}.") from None
    if sheet is None:
        raise fault("no-rows", path, reader.none, reader.fix)
    return sheet
