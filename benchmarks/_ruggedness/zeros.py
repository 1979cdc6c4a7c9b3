"""Tares, jumps, drifts and losses of the zero, put into good records at random."""

from collections import Counter, defaultdict
from typing import NamedTuple

import numpy as np

from hysteresis import InputError, Record
from hysteresis.internal import check_identifiable
from hysteresis.records._cycles import noise_level
from hysteresis.records._zero import _parts, _shift, lost_contact, zero_drift, zero_jumps

from .._measure import Row, judged, noted
from .._trust.idle_warnings import files

CODES = {"zero-jump", "zero-moves", "lost-contact"}
KINDS = {"tare": 0.95, "jump": 0.8, "drift": 0.75, "contact": 0.8}
"""What is put in, and the share of those of 15 to 50 % of the range that was once found."""

SIZES = (0.02, 0.05, 0.15, 0.5)
HELD = 20
"""Rows of a hold in which a tare is put."""

DRIFTING = ("rig: warming load cell", "rig: leaking charge", "laminate", "knitted sleeve")
"""Whose cards say that they do; and an amplifier's charge leaks."""


class Fault(NamedTuple):
    """A record with a fault: its kind, first and last row, and size."""

    record: Record
    kind: str
    first: int
    last: int
    size: float


def rows(quick: bool) -> list[Row]:
    """False findings on good files, and the shares found."""
    said, wrong, count = Counter[str](), 0, 0
    found: dict[tuple[str, int], list[bool]] = defaultdict(list)
    once: list[bool] = []
    for name, records in files(quick):
        codes: set[str] = set()
        for k, record in enumerate(records):
            try:
                codes |= {note.code for note in check_identifiable(record)} & CODES
            except InputError:
                continue
            for kind in KINDS if k < 2 else ():
                for size in range(1 if kind == "contact" else 3):
                    rng = np.random.default_rng([size, k, len(record)])
                    fault = _put(
                        record, kind, np.exp(rng.uniform(*np.log(SIZES[size : size + 2]))), rng
                    )
                    hit, others = _found(fault)
                    cycles = record.cycle_counts.max()
                    decided = kind == "tare" or cycles > (2 if kind == "drift" else 1)
                    decided = decided and not (kind == "jump" and _alone(fault))
                    (found[kind, 2 if kind == "contact" else size] if decided else once).append(hit)
                    wrong, count = wrong + others, count + 1
        if not name.startswith(DRIFTING):
            said.update(codes)
    false = [judged("good files on which a fault of the zero is told", sum(said.values()), 0)]
    false += [noted(f"findings beside the fault, of {count}", wrong)]
    for (kind, size), hits in sorted(found.items()):
        low, high = (f"{100 * x:g}" for x in SIZES[size : size + 2])
        of = "contact lost" if kind == "contact" else f"{kind} of {low} to {high} % of the range"
        what, share = f"{of}, found of {len(hits)}", float(np.mean(hits))
        false.append(
            judged(what, share, KINDS[kind], at_least=True) if size == 2 else noted(what, share)
        )
    if once:
        what = f"put where no branch is passed twice, found of {len(once)}"
        false.append(noted(what, float(np.mean(once)), reason="nothing tells them"))
    return false


def _put(record: Record, kind: str, share: float, rng: np.random.Generator) -> Fault:
    """A fault in the sequence with most cycles, at a row that counts."""
    parts = [rows for _, rows in record.sequences()]
    rows = parts[int(np.argmax([*record.cycle_counts]))] if record.n_cycles else parts[0]
    used = rows.start + np.flatnonzero(record.mask[rows] & np.isfinite(record.output[rows]))
    first, last = int(rng.choice(used[len(used) // 10 : -(len(used) // 10) - 1])), rows.stop
    every = np.arange(len(record))
    if kind == "tare":
        every = np.insert(every, first, np.full(HELD, first))
        first, last = first + HELD // 2, last + HELD
    u, y = record.input[every], record.output[every]
    noise = noise_level(record.output[used]) * rng.normal(size=len(u))
    size = float(
        rng.choice([-1, 1])
        * share
        * np.ptp(record.output[record.mask & np.isfinite(record.output)])
    )
    if kind == "tare":
        y[first - HELD // 2 : first + HELD // 2] += noise[first - HELD // 2 : first + HELD // 2]
    if kind in ("tare", "jump"):
        y[first:last] += size
    elif kind == "drift":
        first = rows.start
        y[rows] += size * np.linspace(0, 1, last - first)
    else:
        ends = first + int(rng.uniform(0.1, 0.3) * len(used))
        last = min(ends, last) if rng.random() < 0.5 else last
        y[first:last] = record.output[used[0]] + noise[first:last]
    labels = np.repeat(np.arange(len(parts)), [one.stop - one.start for one in parts])[every]
    changed = Record.from_arrays(u, y, groups=labels, mask=record.mask[every], nan="omit")
    return Fault(changed, kind, first, last - 1, size)


def _alone(fault: Fault) -> bool:
    """Whether no branch is passed both before and behind a jump."""
    parts = [one for one in _parts(fault.record) if fault.first in one.row]
    return all(
        _shift(one.u, one.y, int(np.searchsorted(one.row, fault.first))) is None for one in parts
    )


def _found(fault: Fault) -> tuple[bool, bool]:
    """Whether it is found, at its place and in its size, and whether anything else is."""
    lost = lost_contact(fault.record)
    jumps = zero_jumps(fault.record, lost)
    if fault.kind in ("tare", "jump"):
        right = [
            one
            for one in jumps
            if abs(one.row - fault.first) <= 2 and abs(one.size / fault.size - 1) < 0.25
        ]
        return bool(right), len(jumps) > len(right) or bool(lost)
    if fault.kind == "drift":
        drift = zero_drift(fault.record)
        return drift is not None and abs(drift.size / fault.size - 1) < 0.4, bool(jumps or lost)
    slack = 0.3 * (fault.last - fault.first)
    hit = any(abs(a - fault.first) <= slack and abs(b - fault.last) <= slack for a, b, _ in lost)
    return hit, bool(jumps)
