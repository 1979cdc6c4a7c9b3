"""Rows of the loading and of the unloading branch, and a record of both side by side."""

from collections.abc import Collection
from typing import Any

import numpy as np

from .._errors import InputError
from .._format import quantity
from .._note import Note
from ._abstract_record import AbstractRecord

BRANCHES = {"loading": 1, "unloading": -1}


def selected(record: Any, branch: str | None, range: Any, cycle: Any) -> Any:
    """`Record.select`."""
    keep, said = np.ones(len(record), bool), []
    if range is not None and not range[0] <= range[1]:
        raise InputError(
            "zero-range", f"No input is within {range[0]:g} to {range[1]:g}.",
            fix="give LOW,HIGH (--range 2,20).",
        )  # fmt: skip
    if branch == "both":
        one = record.select(None, range, cycle)
        loading, unloading = (_on_branch(one, sign) for sign in BRANCHES.values())
        return _side_by_side(one, loading, unloading)
    if branch is not None:
        if branch not in BRANCHES:
            raise InputError("bad-condition", f"No branch {branch!r}; have {[*BRANCHES, 'both']}.")
        keep &= _on_branch(record, BRANCHES[branch])
        said.append(f"the {branch} branch")
    if range is not None:
        # A bound in a converted unit is off by rounding.
        margin = 1e-9 * (range[1] - range[0])
        keep &= (record.input >= range[0] - margin) & (record.input <= range[1] + margin)
        said.append(f"input {range[0]:g} to {quantity(range[1], record.input_unit)}")
    if cycle is not None:
        wanted = sorted(cycle) if isinstance(cycle, Collection) else [cycle]
        keep &= np.isin(record.cycle, wanted)
        said.append(f"cycle {', '.join(map(str, wanted))}")
    if not said:
        return record
    return record._narrow(keep, "selected", f"Only {' and '.join(said)} counts.")


def _on_branch(record: AbstractRecord, sign: int) -> np.ndarray:
    """Rows of one branch, (n,), with the sample where it begins: that ends the branch before."""
    on = record.branch == sign
    begins = np.append(on[1:], False)
    begins[record.starts[1:] - 1] = False  # a row before another sequence
    return on | begins


def _side_by_side(record: Any, loading: np.ndarray, unloading: np.ndarray) -> Any:
    """Every sequence twice, the rows of its loading branch counting in one, of the other in the other."""
    rows, mask, labels, starts = [], [], [], []
    for label, s in record.sequences():
        for name, on in (("loading", loading), ("unloading", unloading)):
            starts.append(sum(map(len, rows)))
            rows.append(np.arange(s.start, s.stop))
            mask.append(record.mask[s] & on[s])
            labels.append(f"{label} {name}".strip())
    said = Note("selected", "The loading and the unloading branch count, side by side.")
    index = np.concatenate(rows)
    whole = record._take(index, said, starts=np.array(starts), labels=tuple(labels))
    return whole._narrow(
        np.concatenate(mask), "selected", "Turning samples count in both branches."
    )
