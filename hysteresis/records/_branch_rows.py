"""A record on other rows: those of a branch, of an even clock; and what several channels have in common."""

from collections.abc import Collection, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from .._errors import InputError
from .._format import quantity
from .._verdict import Note
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


def resampled(record: Any, dt: float) -> Any:
    """`Record.resample`."""
    if record.time is None or not dt > 0:
        why = "there is no time column" if record.time is None else f"the step is {dt:g}"
        raise InputError("no-time", f"Cannot resample: {why}.", fix="give time= or dt=.")
    y, clock, rows = [], [], []
    inputs = {"": record.input}
    inputs |= {name: record.columns[name] for name in (*record.channels, *record.conditions)}
    moved: dict[str, list[np.ndarray]] = {name: [] for name in inputs}
    for _, s in record.sequences():
        t, out = record.time[s], record.output[s]
        c = t[0] + dt * np.arange(int((t[-1] - t[0]) / dt * (1 + 1e-12)) + 1)
        good = np.isfinite(out)
        for name, x in inputs.items():
            moved[name].append(np.interp(c, t, x[s]))
        y.append(np.interp(c, t[good], out[good]) if good.any() else np.full(len(c), np.nan))
        rows.append(s.start + np.searchsorted((t[1:] + t[:-1]) / 2, c))
        clock.append(c)
    starts = np.cumsum([0, *map(len, clock[:-1])])
    whole = {name: np.concatenate(parts) for name, parts in moved.items()}
    sentence = f"Resampled {len(record)} rows to a step of {quantity(dt, record.time_unit)}."
    said = Note("resampled", sentence)
    changes = {"starts": starts, "input": whole.pop(""), "output": np.concatenate(y)}
    changes["time"] = np.concatenate(clock)
    taken = record._take(np.concatenate(rows), said, **changes)
    return replace(taken, columns={**taken.columns, **whole})


STILL = 0.02
"""Part of its range over all sequences within which a condition stays in each."""


def common_part(
    channels: Float[np.ndarray, "samples channels"], output: Float[np.ndarray, " samples"]
) -> Float[np.ndarray, " samples"]:
    """What the channels have in common, in standard deviations: their first principal component.

    It tells where cycles begin before anything is fitted. Each channel counts by its standard deviation,
    and the sign is the one with which it rises with the output; NaN where a channel is.
    """
    whole = np.isfinite(channels).all(1)
    known = channels[whole] if whole.any() else np.zeros((1, channels.shape[1]))
    spread = known.std(0)
    x = (channels - known.mean(0)) / np.where(spread > 0, spread, np.inf)
    direction = np.linalg.eigh(x[whole].T @ x[whole])[1][:, -1]
    s = x @ direction
    both = whole & np.isfinite(output)
    return -s if both.sum() > 1 and np.cov(s[both], output[both])[0, 1] < 0 else s


def constant_within(
    channels: Mapping[str, Float[np.ndarray, " samples"]], starts: Int[np.ndarray, " sequences"]
) -> str | None:
    """The one channel that stays in every sequence and differs between them; None without one."""
    found = []
    for name, x in channels.items():
        if len(x) and np.isfinite(x).all():
            within = np.maximum.reduceat(x, starts) - np.minimum.reduceat(x, starts)
            if np.ptp(x) > 0 and within.max() <= STILL * np.ptp(x):
                found.append(name)
    return found[0] if len(found) == 1 else None
