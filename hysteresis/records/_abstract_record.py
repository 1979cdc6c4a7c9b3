"""The samples of a record: their fields, what must hold between them, their sequences and cycles."""

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import Any, Literal

import numpy as np

from .._errors import InputError
from .._format import duration, quantity
from .._quantities import conversion
from .._verdict import Note
from ._arrays import LARGEST, LEAST_RANGE, same_length
from ._cycles import branches, cycles, first_of_cycles

KNOWN = "known_rows"
"""The column of a record that says which rows are `known`."""


@dataclass(frozen=True, eq=False)
class AbstractRecord:
    """Samples of an input and an output in independent sequences; see `Record`, its only kind.

    It holds what summaries and warnings are made from, so that a record can have both as methods.
    """

    input: np.ndarray
    output: np.ndarray
    time: np.ndarray | None
    starts: np.ndarray
    labels: tuple[str, ...]
    mask: np.ndarray
    line: np.ndarray
    input_name: str = "input"
    output_name: str = "output"
    time_name: str = "time"
    input_unit: str = "1"
    output_unit: str = "1"
    time_unit: str = "1"
    history: tuple[Note, ...] = ()
    source: str = ""
    sha256: str = ""
    columns: Mapping[str, np.ndarray] = field(default_factory=dict)
    channels: Mapping[str, str] = field(default_factory=dict)
    conditions: Mapping[str, str] = field(default_factory=dict)
    sigma_name: str = ""

    def __post_init__(self) -> None:
        line = np.asarray(self.line)
        types = {"input": float, "output": float, "mask": bool, "starts": int}
        types["line"] = line.dtype if line.dtype.kind == "i" else int
        if self.time is not None:
            types["time"] = float
        for name, kind in types.items():
            array = np.asarray(getattr(self, name), kind).view()
            array.flags.writeable = False
            object.__setattr__(self, name, array)
        object.__setattr__(self, "history", tuple(map(Note.of, self.history)))
        same_length(
            time=self.time, input=self.input, output=self.output, mask=self.mask, line=self.line
        )
        starts = self.starts
        if len(starts) != len(self.labels) or starts[:1].tolist() != [0]:
            raise InputError("length-mismatch", "Each sequence needs a first row and a label.")
        if np.any(np.diff(starts) <= 0) or starts[-1] >= max(len(self), 1):
            raise InputError("length-mismatch", f"Sequences start at {starts} of {len(self)} rows.")
        self._check_finite()
        self._check_clock()
        if (sigma := self.sigma) is None:
            return
        if (bad := self.mask & ~((sigma > 0) & (sigma < np.inf))).any():
            said = f"{bad.sum()} blank, 0, negative or infinite in sigma {self.sigma_name!r}"
            mend = "give a standard deviation above 0 in every row that counts, a large one where in doubt."
            raise self._fault("bad-deviation", said, bad, fix=mend)

    def _check_finite(self):
        wanted: list[tuple[str, str, np.ndarray, Any]]
        wanted = [("input", name, self.columns[name], True) for name in self.channels]
        wanted += [("condition", name, self.columns[name], True) for name in self.conditions]
        wanted.append(("input", self.input_name, self.input, True))
        wanted.append(("output", self.output_name, self.output, self.mask))
        for role, name, x, where in wanted:
            # Without those that are not numbers, and without a copy; NaN of no number at all.
            low, high = (f.reduce(x, dtype=float, initial=np.nan) for f in (np.fmin, np.fmax))
            if np.isinf([low, high]).any():
                bad = np.isinf(x)
                raise self._fault("not-finite", f"{bad.sum()} infinite in {role} {name!r}", bad)
            if max(-low, high) > LARGEST:
                bad = np.abs(x) > LARGEST
                said = f"{bad.sum()} beyond {LARGEST:g} in {role} {name!r}"
                raise self._fault("too-large", said, bad)
            if 0 < high - low < LEAST_RANGE:
                raise self._fault(
                    "zero-range", f"the range of {role} {name!r} is {high - low:.3g}", ~np.isnan(x),
                    fix="use a smaller unit.",
                )  # fmt: skip
            if not (bad := np.isnan(x) & where).any():
                continue
            fill = 'nan="interpolate" (--nan interpolate) fills them in a straight line.'
            if any(np.isnan(part).all() for part in np.split(x, self.starts[1:])):
                fill = "leave out the sequence that has none at all."
            if role != "output":
                fill = f"hysteresis needs complete {role}; {fill}"
            else:
                fill = f'nan="omit" (--nan omit) masks them, history still runs; {fill}'
            raise self._fault(f"nan-{role}", f"{bad.sum()} NaN in {role} {name!r}", bad, fix=fill)

    def _check_clock(self):
        if self.time is None:
            return
        if not (good := np.isfinite(self.time)).all():
            mend = "drop those rows, or give the step instead: dt=... (--dt SECONDS)."
            raise self._fault(
                "nan-time", f"{(~good).sum()} NaN in time {self.time_name!r}", ~good, fix=mend
            )
        after, before = self.time[1:], self.time[:-1]
        ends = self.starts[1:] - 1  # each sequence has its own clock
        back, same = after < before, after == before
        back[ends] = same[ends] = False
        if (k := np.flatnonzero(back)).size:
            t, where = self.time, self.lines(k[:1] + 1)
            raise InputError(
                "time-backwards",
                f"Time goes back from {t[k[0]]:.9g} to {t[k[0] + 1]:.9g} at {where}.",
                place=self.source,
                cause=f"{k.size + 1} runs in one file?",
                fix='segments="auto" (--segments auto) makes each its own sequence, and so does the'
                " column that tells them apart (--group COL).",
            )
        if (k := np.flatnonzero(same)).size:
            raise InputError(
                "time-repeated",
                f"{self.lines(k[0] + np.arange(2))} have the same time {self.time[k[0]]:.9g}"
                f"{f', and {k.size - 1} more pairs' if k.size > 1 else ''}.",
                place=self.source,
                cause="a clock coarser than the sampling, or rows written twice.",
                fix="drop or average them, or give the step instead: dt=... (--dt SECONDS).",
            )

    def lines(self, rows: np.ndarray) -> str:
        """The lines of the first and the last of these rows, in words."""
        word, (first, last) = "line" if self.source else "row", np.sort(self.line[rows[[0, -1]]])
        return f"{word} {first}" if first == last else f"{word}s {first} to {last}"

    def place(self, row: int) -> str:
        """A row's line in words, and its time where there is a clock."""
        at = self.lines(np.array([row]))
        return at if self.time is None else f"{at} ({quantity(self.time[row], self.time_unit, 6)})"

    def _fault(self, code: str, what: str, bad: np.ndarray, fix: str = "mask or mend them."):
        rows = np.flatnonzero(bad)
        lasts = ""
        if self.time is not None and rows.size > 1 and np.isfinite(self.time[rows]).all():
            lasts = f" ({duration(float(np.ptp(self.time[rows])), self.time_unit)})"
        return InputError(code, f"{what}, {self.lines(rows)}{lasts}.", place=self.source, fix=fix)

    def __len__(self) -> int:
        return len(self.input)

    def sequences(self) -> Iterator[tuple[str, slice]]:
        """`(label, rows)` of each sequence."""
        for label, (a, b) in zip(self.labels, pairwise([*self.starts, len(self)]), strict=True):
            yield label, slice(int(a), int(b))

    @cached_property
    def cycle(self) -> np.ndarray:
        """Complete cycle 1, 2, ... of each row within its sequence, 0 for none, (n,)."""
        return np.concatenate([cycles(self.input[s]) for _, s in self.sequences()])

    @cached_property
    def branch(self) -> np.ndarray:
        """+1 on loading, -1 on unloading rows, (n,)."""
        return np.concatenate([branches(self.input[s]) for _, s in self.sequences()])

    @cached_property
    def first_of_cycles(self) -> list[np.ndarray]:
        """Of each sequence the first row of every complete cycle, and of what follows the last one."""
        return [first_of_cycles(self.input[s]) for _, s in self.sequences()]

    @property
    def known(self) -> np.ndarray | None:
        """First rows of sequences, whose output tells the state for the rest, (n,); None: none."""
        return self.columns[KNOWN] > 0 if KNOWN in self.columns else None

    @property
    def sigma(self) -> np.ndarray | None:
        """Standard deviation of each output, (n,), but for a factor common to all; None: all alike."""
        return self.columns[self.sigma_name] if self.sigma_name else None

    @cached_property
    def weights(self) -> np.ndarray:
        """1 / sigma, (n,), its mean square 1 over the rows that count; without sigma 1.

        Times an error it is in the output's unit still: every fit, error figure and noise is of this.
        """
        if self.sigma is None or not self.mask.any():
            return np.broadcast_to(1.0, len(self))
        return np.where(self.mask, self.typical_sigma / np.where(self.mask, self.sigma, 1.0), 0.0)

    @cached_property
    def typical_sigma(self) -> float:
        """The sigma of a row of weight 1: 1 / the rms of 1 / sigma over the rows that count."""
        assert self.sigma is not None
        sigma = self.sigma[self.mask]
        return float(sigma.min() / np.sqrt(np.mean((sigma.min() / sigma) ** 2)))

    @property
    def cycle_counts(self) -> np.ndarray:
        """Complete cycles of each sequence, (m,)."""
        return np.array([len(firsts) - 1 for firsts in self.first_of_cycles])

    @property
    def n_cycles(self) -> int:
        """Complete cycles of all sequences together."""
        return int(self.cycle_counts.sum())

    def digest(self) -> str:
        """SHA-256 of arrays and labels: equal for equal data, wherever they came from."""
        code = hashlib.sha256("\0".join(self.labels).encode())
        names = *sorted(self.channels), *sorted(self.conditions), *filter(None, [self.sigma_name])
        more = [self.columns[name] for name in names]
        more += [] if self.known is None else [self.known]
        for x in (self.input, self.output, self.time, self.starts, self.mask, *more):
            code.update(b"-" if x is None else np.ascontiguousarray(x).data)
        return code.hexdigest()


# Loads and deformations, told by their units: which of them the input is.

LOADS = ("N", "Pa", "N*m")
DEFORMATIONS = ("m", "rad", "percent")
"""One unit of each quantity. A ratio, as of a strain, is one only beside a load."""


def kind_of_units(record: AbstractRecord) -> Literal["creep", "relaxation"] | None:
    """Creep where a load is the input and a deformation is read, relaxation the other way round.

    None where the units do not say: they are unknown, or neither of the two is a load.
    """
    units = record.input_unit, record.output_unit
    is_load, deforms = (
        [any(conversion(unit, one) is not None for one in known) for unit in units]
        for known in (LOADS, DEFORMATIONS)
    )
    # "1" may be any quantity that nobody named.
    deforms = [yes and unit != "1" for yes, unit in zip(deforms, units, strict=True)]
    if is_load[0] and deforms[1]:
        return "creep"
    return "relaxation" if deforms[0] and is_load[1] else None


def over(one: str, other: str) -> str:
    """The unit of a quotient."""
    return one if other == "1" else f"{one} / {other}"


def times(one: str, other: str) -> str:
    """The unit of a product."""
    return one if other == "1" else other if one == "1" else f"{one} * {other}"
