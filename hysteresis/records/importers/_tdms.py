"""TDMS files, LabVIEW's binary ones, through npTDMS (an extra: pip install 'hysid[rigs]')."""

import io
import logging
from pathlib import Path
from typing import Any

import numpy as np

from ._sheet import Sheet, distinct, sheet_of_arrays

MARK = b"TDSm"


def tdms(path: Path, data: bytes, table: int | None = None) -> Sheet | None:
    """The table of a TDMS file, None where no channel holds numbers.

    The channels of a group are its columns, with "time" from their step where they have one; groups with
    the same channels are put under one another. Channels of another length than most are left out, and
    named.
    """
    from nptdms import TdmsFile
    from nptdms.log import log_manager

    log_manager.set_level(logging.ERROR)  # a damaged file is said in our own words
    units: dict[str, str] = {}
    arrays = {
        group.name: _columns(group.channels(), units, len(data))
        for group in TdmsFile.read(io.BytesIO(data)).groups()
    }
    return sheet_of_arrays(arrays, units, "a TDMS file", table=table)


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
        found[name] = x
        if unit := channel.properties.get("unit_string"):
            units[name] = str(unit)
    return found
