"""TDMS files, LabVIEW's binary ones, through npTDMS (an extra: pip install 'hysid[rigs]')."""

import io
import logging
from pathlib import Path
from typing import Any

import numpy as np

from ..._note import Note
from ._file import fault
from ._sheet import Sheet, distinct

MARK = b"TDSm"


def tdms(path: Path, data: bytes) -> Sheet | None:
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
    try:
        groups = {
            group.name: group.channels() for group in TdmsFile.read(io.BytesIO(data)).groups()
        }
    except Exception as error:  # npTDMS raises what it meets: ValueError, KeyError, struct.error
        raise fault("damaged-file", path, f"this TDMS file is damaged: {error}.") from None
    tables = {name: _columns(channels) for name, channels in groups.items()}
    tables = {name: found for name, found in tables.items() if found[0]}
    if not tables:
        raise fault("no-rows", path, "no channel holds numbers.")
    families: dict[tuple, list[str]] = {}
    for name, (columns, _, _) in tables.items():
        families.setdefault(tuple(columns), []).append(name)
    chosen = max(families.values(), key=lambda names: sum(_rows(tables[n][0]) for n in names))
    columns, units, notes = tables[chosen[0]]
    notes = [Note("format", "Read as a TDMS file."), *notes]
    cells = {name: [c for g in chosen for c in tables[g][0][name]] for name in columns}
    if len(chosen) > 1:
        (name,) = distinct(["group"], list(cells))
        cells = {name: [g for g in chosen for _ in range(_rows(tables[g][0]))]} | cells
        said = f"Put {len(chosen)} groups under one another, told apart by {name!r}."
        notes.append(Note("joined", said))
    if others := [name for name in tables if name not in chosen]:
        notes.append(Note("skipped", f"Left out groups with other channels: {', '.join(others)}."))
    return Sheet(cells, np.arange(1, _rows(cells) + 1), units, tuple(notes))


def _rows(columns: dict[str, list[str]]) -> int:
    return len(next(iter(columns.values())))


def _columns(channels: list[Any]) -> tuple[dict[str, list[str]], dict[str, str], list[Note]]:
    """Cells and units of the channels of one group, and what was left out of it."""
    filled = [c for c in channels if len(c)]
    lengths = [len(c) for c in filled]
    if not filled:
        return {}, {}, []
    rows = max(lengths, key=lengths.count)
    kept = [c for c in filled if len(c) == rows]
    notes = [
        Note("skipped", f"Left out {c.name!r}: {len(c)} samples, others {rows}.")
        for c in filled
        if c not in kept
    ]
    names = distinct([c.name for c in kept])
    columns, units = {}, {}
    if step := kept[0].properties.get("wf_increment"):
        start = kept[0].properties.get("wf_start_offset", 0.0)
        (clock,) = distinct(["time"], names)
        columns[clock] = [f"{start + step * k:.12g}" for k in range(rows)]
        units[clock] = "s"
    for name, channel in zip(names, kept, strict=True):
        x = channel[:]
        if np.issubdtype(x.dtype, np.datetime64):  # a clock of time stamps, from the first on
            x = (x - x[0]) / np.timedelta64(1, "s")
            units[name] = "s"
        columns[name] = [str(v) for v in np.asarray(x).tolist()]
        if unit := channel.properties.get("unit_string"):
            units[name] = str(unit)
    return columns, units, notes
