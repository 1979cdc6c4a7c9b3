"""TDMS files, LabVIEW's binary ones, through npTDMS (an extra: pip install 'hysid[rigs]')."""

import io
import logging
from pathlib import Path
from typing import Any

import numpy as np

from ._file import damage_of, fault
from ._sheet import Sheet, distinct, sheet_of_arrays

MARK = b"TDSm"


def tdms(path: Path, data: bytes, table: int | None = None) -> Sheet | None:
    """The table of a TDMS file, or None where it is none.

    The channels of a group are its columns, with "time" from their step where they have one; groups with
    the same channels are put under one another. Channels of another length than most are left out, and
    named.

    Raises `InputError` `missing-extra` without npTDMS, `damaged-file`, `no-rows`.
    """
    if data[:4] != MARK:
        return None
    try:
        from nptdms import TdmsFile
        from nptdms.log import log_manager
    except ImportError:
        raise fault(
            "missing-extra", path, "TDMS files are read by npTDMS, which is not installed.",
            "pip install 'hysid[rigs]', or export the file as text (.lvm, .csv).",
        ) from None  # fmt: skip
    log_manager.set_level(logging.ERROR)  # a damaged file is said in our own words
    with damage_of("damaged-file", path, "TDMS file"):
        groups = {
            group.name: group.channels() for group in TdmsFile.read(io.BytesIO(data)).groups()
        }
        units: dict[str, str] = {}
        arrays = {name: _columns(channels, units, len(data)) for name, channels in groups.items()}
    sheet = sheet_of_arrays(arrays, units, "a TDMS file", table=table)
    if sheet is None:
        raise fault("no-rows", path, "no channel holds numbers.")
    return sheet


def _columns(channels: list[Any], units: dict[str, str], held: int) -> dict[str, np.ndarray]:
    """The channels of one group; their units go to `units`.

    Raises `ValueError` where they declare more samples than the `held` bytes of the file can be.
    """
    filled = [c for c in channels if len(c)]
    if (declared := sum(map(len, filled))) > held:
        raise ValueError(f"it declares {declared:,} samples, and has {held:,} bytes")
    found: dict[str, np.ndarray] = {}
    names = distinct([c.name for c in filled])
    if filled and (step := filled[0].properties.get("wf_increment")):
        start, step = float(filled[0].properties.get("wf_start_offset", 0.0)), float(step)
        (clock,) = distinct(["time"], names)
        found[clock] = start + step * np.arange(len(filled[0]))
        units[clock] = "s"
    for name, channel in zip(names, filled, strict=True):
        x = np.asarray(channel[:])
        if np.issubdtype(x.dtype, np.datetime64):  # a clock of time stamps, from the first on
            x = (x - x[0]) / np.timedelta64(1, "s")
            units[name] = "s"
        found[name] = x
        if unit := channel.properties.get("unit_string"):
            units[name] = str(unit)
    return found
