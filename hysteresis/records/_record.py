"""Measured sequences of one rig: what went in, what came out, and which rows count."""

from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from copy import deepcopy
from dataclasses import replace
from difflib import get_close_matches
from inspect import signature
from itertools import compress, pairwise
from numbers import Integral, Real
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from .._drawing import html_of, plot_of
from .._errors import InputError
from .._show import at_most
from .._verdict import Note
from ._abstract_record import AbstractRecord
from ._arrays import fill, named_columns, numbers, same_length, tell_nothing, times
from ._branch_rows import common_part, constant_within, resampled, selected
from ._excitation import describe, summary
from ._loop_table import LoopTable, loop_table
from ._units import named_unit

_FIELDS = signature(AbstractRecord.__init__)


class Record(AbstractRecord):
    """Samples of an input and an output in `m` independent sequences; frozen.

    **Arguments:**

    - `input`, `output`: (n,), in `input_unit` and `output_unit`. The output may be NaN outside
        the mask.
    - `time`: (n,) in `time_unit`, rising within each sequence; `None` without a clock.
    - `starts`, `labels`: first row (m,) and name of each sequence; `starts[0] == 0`.
    - `mask`: (n,) the rows that count in a fit or an error figure. The others still drive the
        model: history runs over all rows.
    - `line`: (n,) line of the file, from 1, for messages.
    - `history`: a `Note` for each thing done to the data, a sentence with a code.
    - `source`, `sha256`: name and checksum of the file, "" for arrays.
    - `columns`: further columns (n,) by name, for splitting.
    - `channels`: names and units of those `columns` that a fit combines into the input. Until then the
        input is what they have in common, see `common_part`.
    - `conditions`: names and units of those `columns`, such as a temperature or a pressure, on which the
        output depends too.
    - `sigma_name`: which of the `columns` is the standard deviation of each row's output, see `sigma`.

    Every method returns a new record.

    **Raises:** `InputError` `length-mismatch`, `nan-input`, `nan-output`,
    `not-finite`, `nan-time`, `time-repeated`, `time-backwards`, `bad-deviation`.

    **Example:**

        >>> len(record), record.n_cycles, record.input_unit
        (101, 5, 'N')
    """

    def __init__(self, *arguments: Any, **fields: Any):
        try:
            _FIELDS.bind(self, *arguments, **fields)
        except TypeError as error:
            raise InputError(
                "incomplete-record",
                f"Record() takes every field of a record: {error}.",
                cause="Record() is what the functions that make records call.",
                fix="Record.from_arrays(input, output, time), Record.from_columns(frame, input=..., "
                "output=...), or hysid.read_csv(path, input=..., output=...).",
            ) from None
        super().__init__(*arguments, **fields)

    @classmethod
    def from_columns(
        cls,
        columns: Any,
        input: Any,
        output: Any,
        time: Any = None,
        group: Any = None,
        condition: Any = (),
        sigma: Any = None,
        **options: Any,
    ) -> "Record":
        """A record from the columns of a data frame, a mapping or a structured array.

        **Arguments:**

        - `columns`: a pandas or polars data frame, a mapping from names to rows of numbers (n,), or a NumPy
          array with named fields.
        - `input`, `output`, `time`: names of columns. Several inputs are channels that `fit` combines.
          Units are read from names such as "force (N)" or "force_N", unless `options` give them.
        - `group`: the column whose values name sequences; `condition`: columns such as a temperature, on
          which the output depends too; `sigma`: that of the standard deviations of the output.
        - `options`: further arguments of `from_arrays`, such as `dt`, `nan` or `input_unit`.

        **Returns:** the record.

        **Raises:** `InputError` `no-column`, and as `from_arrays` does.

        **Example:**

            >>> table = {"force (N)": [0, 1, 2], "x (mm)": [0, 0.1, 0.3]}
            >>> hysteresis.Record.from_columns(table, "force (N)", "x (mm)").output_unit
            'mm'
        """
        many = [one if isinstance(one, list | tuple) else [one] for one in (input, condition)]
        inputs, given = ([*map(str, one)] for one in many)
        more = (one if one is None else str(one) for one in (time, group, sigma))
        output, (time, group, sigma) = str(output), more
        asked = [*inputs, output, *given, *(one for one in (time, group, sigma) if one is not None)]
        found = named_columns(columns, asked)
        units = {name: named_unit(name, None, None) or "1" for name in asked}
        own: dict[str, Any] = {"output_name": output, "output_unit": units[output]}
        own["columns"] = {name: found[name] for name in given}
        own["conditions"] = {name: units[name] for name in given}
        if len(inputs) > 1:
            own["channels"] = {name: units[name] for name in inputs}
            own["columns"] |= {name: found[name] for name in inputs}
        else:
            own |= {"input_name": inputs[0], "input_unit": units[inputs[0]]}
        if time is not None:
            bare = units[time] == "1" or found[time].dtype.kind in "mM"
            own |= {"time_name": time, "time_unit": "s" if bare else units[time]}
        of = {name: None if name is None else found[name] for name in (time, group, sigma)}
        u = found[inputs[0]] if len(inputs) == 1 else None
        own |= {"sigma": of[sigma], "sigma_name": sigma or ""}
        return cls.from_arrays(u, found[output], of[time], of[group], **(own | options))

    @classmethod
    def from_arrays(
        cls,
        input: ArrayLike | None,
        output: ArrayLike,
        time: ArrayLike | None = None,
        groups: ArrayLike | None = None,
        *,
        dt: float | None = None,
        mask: ArrayLike | None = None,
        line: ArrayLike | None = None,
        segments: Literal["auto"] | None = None,
        nan: Literal["raise", "omit", "interpolate"] = "raise",
        time_unit: str = "s",
        history: Sequence[str] = (),
        columns: Mapping[str, np.ndarray] | None = None,
        channels: Mapping[str, str] | None = None,
        conditions: Mapping[str, str] | None = None,
        sigma: ArrayLike | None = None,
        **names: str,
    ) -> "Record":
        """A record from (n,) arrays.

        **Arguments:**

        - `groups`: (n,) labels; the rows of one label form a sequence, in their order, also where
            labels interleave.
        - `dt`: step, in `time_unit`, where there is no `time`.
        - `segments`: "auto" starts a new sequence wherever time goes back.
        - `nan`: "raise"; "omit" masks rows without output; "interpolate" fills input and output
            linearly over time (or rows), and by the nearest value at the ends of a sequence.
        - `channels`: several inputs, for an `input` of None: {name: unit} of some of the `columns`. The
            second of two that is constant in every sequence and differs between them is a condition.
        - `conditions`: {name: unit} of the `columns` on which the output depends too.
        - `sigma`: (n,) standard deviations of the outputs, in their unit, but for a factor common to all.
        - `names`: the other fields of `Record`.

        **Raises:** `InputError` as `Record` does, and `not-numbers`, `bad-option`.
        """
        if nan not in ("raise", "omit", "interpolate"):
            raise InputError("bad-option", f"nan={nan!r}.", fix="raise, omit or interpolate.")
        if dt is not None and not (isinstance(dt, Real) and 0 < dt < np.inf):
            raise InputError("bad-option", f"dt={dt!r}.", fix="give a step above 0.")
        shared, kept = nan != "interpolate", dict(columns or {})
        y, done = numbers("output", output, shared), [*map(Note.of, history)]
        more = *(channels or ()), *(conditions or ())
        n, t = y.size, None if time is None else times(time, time_unit)
        given = np.zeros(n if channels else 0) if input is None else input
        u = numbers("input", given, shared)
        group = np.zeros(n, np.int8) if groups is None else np.asarray(groups)
        used = np.ones(n, bool) if mask is None else np.array(mask, bool)
        number = np.arange(1, n + 1) if line is None else np.asarray(line)
        if sigma is not None:
            name = names["sigma_name"] = names.get("sigma_name", "sigma")
            kept[name], more = numbers(name, sigma), (*more, name)
            if (blind := used & tell_nothing(kept[name])).any():
                used &= ~blind
                said = f"Masked {blind.sum()} rows whose sigma is over 1,000 times the median."
                done.append(Note("masked", said))
        kept |= {name: numbers(name, kept[name]) for name in more}
        same_length(time=t, input=u, output=y, groups=group, mask=used, line=number)
        same_length(output=y, **{name: kept[name] for name in more})
        if segments not in (None, "auto"):
            mend = "--segments auto, or none."
            raise InputError("bad-option", f"segments={segments!r}.", fix=mend)
        label, member = np.array(["all"]), group
        if groups is not None:
            unique, first, member = np.unique(group, return_index=True, return_inverse=True)
            member = np.argsort(np.argsort(first))[member]  # number sequences by their first rows
            order = np.argsort(member, kind="stable")
            if np.any(np.diff(order) < 0):
                done.append(Note("gathered", "Gathered the interleaved rows of each group."))
            u, y, used, number, member = (x[order] for x in (u, y, used, number, member))
            t = None if t is None else t[order]
            kept = {name: np.asarray(column)[order] for name, column in kept.items()}
            label = unique[np.argsort(first)]
        inputs = {name: kept[name] for name in channels} if channels else {"input": u}
        cut = np.diff(member) > 0
        if segments == "auto" and t is not None and np.any(back := (np.diff(t) < 0) & ~cut):
            cut |= back
            done.append(Note("cut", f"Cut into {cut.sum() + 1} sequences: time went back."))
        starts = np.flatnonzero(np.append(True, cut))
        labels, seen = [], Counter[str]()
        for name in (str(label[k]) for k in member[starts]) if n else ("all",):
            seen[name] += 1
            labels.append(f"{name}#{seen[name]}" if seen[name] > 1 else name)
        if dt is not None:
            t = dt * (np.arange(n) - np.repeat(starts, np.diff(np.append(starts, n))))
            said = f"Time is the row's number in its sequence, times {dt:g} {time_unit}."
            done.append(Note("time-from-rows", said))
        if nan == "omit" and np.any(gap := np.isnan(y) & used):
            used &= ~gap
            done.append(Note("masked", f"Masked {gap.sum()} rows without output."))
        held = {name: kept[name] for name in conditions or ()}
        for name, x in (inputs | held | {"output": y}).items() if nan == "interpolate" else ():
            if missing := int(np.isnan(x).sum()):
                for a, b in pairwise([*starts, n]):
                    fill(x[a:b], np.arange(b - a) if t is None else t[a:b])
                said = f"Filled {missing} NaN of the {name} by linear interpolation."
                done.append(Note("filled", said))
        channels, conditions = dict(channels or {}), dict(conditions or {})
        if len(channels) == 2 and (still := constant_within(inputs, starts)):
            conditions |= {still: channels.pop(still)}
            ((alone, own),) = channels.items()
            u, channels, names = kept[alone], {}, {"input_name": alone, "input_unit": own} | names
            said = f"{still!r} is constant in every sequence and differs between them: a condition."
            done.append(Note("condition", said))
        if channels:
            u = common_part(np.column_stack([*inputs.values()]), y)
            names.setdefault("input_name", f"common part of {len(channels)} channels")
        unit = "1" if t is None else time_unit
        return cls(
            u, y, t, starts, tuple(labels), used, number, time_unit=unit, history=tuple(done), columns=kept,
            channels=channels, conditions=conditions,
            **names,  # pyright: ignore[reportArgumentType]
        )  # fmt: skip

    def noted(self, code: str, said: str, **changes: Any) -> "Record":
        """The record with some fields changed, and with a note in its history of what was done.

        **Arguments:**

        - `code`, `said`: of the `Note`.
        - `changes`: the fields, by name.

        **Raises:** `InputError` as `Record` does.
        """
        return replace(self, history=(*self.history, Note(code, said)), **changes)

    def _narrow(self, keep: np.ndarray, code: str, sentence: str) -> "Record":
        mask = self.mask & keep
        if not mask.any():
            raise InputError("no-rows", f"No row is left. {sentence}", place=self.source)
        return self.noted(code, sentence, mask=mask)

    def select(
        self,
        branch: Literal["loading", "unloading", "both"] | None = None,
        range: tuple[float, float] | None = None,
        cycle: int | Collection[int] | None = None,
    ) -> "Record":
        """Narrow the mask to a branch, to inputs in `[lo, hi]`, to cycles by number.

        A sample where the input turns belongs to both branches. So "both" is the loading branch and the
        unloading branch side by side, as sequences of their own, and turning samples count twice; without
        a branch every row counts once.

        **Raises:** `InputError` `bad-condition`, `zero-range`, and `no-rows` where nothing is left.
        """
        return selected(self, branch, range, cycle)

    def exclude(self, rows: ArrayLike) -> "Record":
        """The record without these rows (n,) in its mask: they drive the model, and do not count.

        **Raises:** `InputError` `length-mismatch`, `no-rows`.

        **Example:**

            >>> shorter = record.exclude(record.input > 19.9)
            >>> int(record.mask.sum()), int(shorter.mask.sum())
            (101, 96)
        """
        rows = np.asarray(rows, bool)
        same_length(input=self.input, rows=rows)
        said = f"Excluded {int((rows & self.mask).sum())} rows by hand."
        return self._narrow(~rows, "excluded", said)

    def _split(self, train: np.ndarray, test: np.ndarray, how: str) -> "tuple[Record, Record]":
        held = f"{int((test & self.mask).sum())} rows, {how}"
        return (
            self._narrow(train, "held-out", f"Held out for testing: {held}."),
            self._narrow(test, "test-rows", f"Only what was held out counts: {held}."),
        )

    def split_cycles(self, test: int) -> "tuple[Record, Record]":
        """`(train, test)`: the last `test` complete cycles of each sequence are held out.

        Rows in no cycle count in neither. Raises `too-few-cycles` where a sequence would have
        none to train on.
        """
        if isinstance(test, bool) or not isinstance(test, Integral):
            raise InputError("bad-option", f"{test!r} cycles.", fix="give a whole number.")
        counts = self.cycle_counts
        short = np.flatnonzero(counts <= test) if test > 0 else np.arange(len(counts))
        if short.size:
            others = f" (so {short.size - 1} more sequences)" if short.size > 1 else ""
            raise InputError(
                "too-few-cycles",
                f"Sequence {self.labels[short[0]]!r} has {counts[short[0]]} complete cycles"
                f"{others}; cannot hold out {test} and train on the rest.",
                place=self.source,
                fix="hold out fewer cycles, whole sequences (--test-where COL=VALUE), or a tail "
                "(--test-tail FRACTION).",
            )
        limit = np.repeat(counts - test, np.diff([*self.starts, len(self)]))
        train = (self.cycle > 0) & (self.cycle <= limit)
        return self._split(train, self.cycle > limit, f"the last {test} cycles of each sequence")

    def split_groups(
        self, test: Callable[[str], bool] | Collection[str]
    ) -> "tuple[Record, Record]":
        """`(train, test)`: whole sequences held out, by label or by a predicate of the label."""
        chosen = [x for x in self.labels if test(x)] if callable(test) else list(test)
        rest = [x for x in self.labels if x not in chosen]
        return self.take_sequences(rest), self.take_sequences(chosen)

    def split_rows(self, test_mask: ArrayLike) -> "tuple[Record, Record]":
        """`(train, test)`: the rows (n,) where `test_mask` holds are held out."""
        test = np.asarray(test_mask, bool)
        same_length(input=self.input, test_mask=test)
        return self._split(~test, test, "chosen by their values")

    def split_tail(self, fraction: float) -> "tuple[Record, Record]":
        """`(train, test)`: the last `fraction` of the rows of each sequence is held out."""
        if not 0 < fraction < 1:
            said = f"A tail of {fraction:g} of the rows cannot be held out."
            mend = "a fraction between 0 and 1 (--test-tail 0.2)."
            raise InputError("bad-option", said, fix=mend)
        ends = np.append(self.starts[1:], len(self))
        first = ends - np.ceil(fraction * (ends - self.starts)).astype(int)
        test = np.arange(len(self)) >= np.repeat(first, ends - self.starts)
        return self._split(~test, test, f"the last {fraction:.3g} of each sequence")

    def take_sequences(self, labels: Collection[str]) -> "Record":
        """Only these sequences, in the record's order. Raises `bad-condition`."""
        for label in labels:
            if label not in self.labels:
                near = get_close_matches(label, self.labels, 5, 0.0)
                raise InputError("bad-condition", f"No sequence {label!r}; have {', '.join(near)}.")
        kept = [(x, s) for x, s in self.sequences() if x in labels]
        if not kept:
            raise InputError("no-rows", "No sequence is left.", place=self.source)
        rows = np.concatenate([np.arange(s.start, s.stop) for _, s in kept])
        said = Note("sequences", f"Kept {len(kept)} of {len(self.labels)} sequences.")
        return self._in_order(rows, said)

    def take_rows(self, first: int, stop: int) -> "Record":
        """Rows `first` to `stop` - 1, a record that begins in the middle of a history where `first` > 0.

        Raises `no-rows` where there are none.
        """
        rows = np.arange(len(self))[first:stop]
        if not len(rows):
            raise InputError("no-rows", f"No row from {first:,} to {stop:,}.", place=self.source)
        said = Note("rows", f"Kept rows {rows[0]:,} to {rows[-1]:,} of {len(self):,}.")
        return self._in_order(rows, said)

    def _in_order(self, rows: np.ndarray, said: Note, **changes: Any) -> "Record":
        """Rows by their rising numbers, in the sequences that have some."""
        firsts = np.append(np.searchsorted(rows, self.starts), len(rows))
        labels = tuple(compress(self.labels, some := np.diff(firsts) > 0))
        return self._take(rows, said, starts=firsts[:-1][some], labels=labels, **changes)

    def _take(self, rows: np.ndarray, said: Note, **changes: Any) -> "Record":
        every = ("input", "output", "mask", "line", *(() if self.time is None else ("time",)))
        taken = {k: getattr(self, k)[rows] for k in every}
        columns = {name: column[rows] for name, column in self.columns.items()}
        return self.noted(said.code, said, **(taken | {"columns": columns} | changes))

    def resample(self, dt: float) -> "Record":
        """Linear interpolation of each sequence onto a clock of step `dt`, in `time_unit`.

        Mask, lines and further columns are those of the nearest row. No filter: average first
        where the step is much longer than the noise.
        """
        return resampled(self, dt)

    def loops(self, kind: str | None = None) -> LoopTable:
        """A `LoopTable`: of every loop its extremes, widths, stiffness, energy and damping, with errors.

        Loops over a magnetic or an electric field have coercive field, remanence, saturation and loss.
        Errors come from the noise of the readings and the sampling step. What a loop does not tell is
        empty, with a reason.

        **Arguments:**

        - `kind`: "mechanical", "magnetic", "ferroelectric" or "plain"; by default as units and names tell.

        **Raises:** `InputError` `bad-option`.

        **Example:**

            >>> table = record.loops()
            >>> len(table), table["energy lost"].unit, table.summary[0].name
            (5, 'N * mm', 'duration')
        """
        return loop_table(self, kind)

    def summary(self) -> dict[str, Any]:
        """Rows, sequences, cycles, ranges, noise, clock, saturation and loop direction."""
        return deepcopy(summary(self))

    def describe(self, loop: str | None = None) -> str:
        """The summary for a reader, and the history; `loop` replaces the line about the loops."""
        return describe(self, loop)

    def plot(self) -> Any:
        """Output against input as a matplotlib `Figure`; rows that do not count are grey.

        **Returns:** a `matplotlib.figure.Figure`, which a notebook shows and `savefig` writes.

        **Raises:** `InputError` `missing-extra` where matplotlib cannot be imported.
        """
        return plot_of(self)

    def __str__(self) -> str:
        return "\n".join(at_most(self.describe().split("\n")))

    def __repr__(self) -> str:
        sides = f"{self.input_name!r} -> {self.output_name!r}"
        return f"<Record of {len(self)} rows, {len(self.labels)} sequences: {sides}>"

    def _repr_html_(self) -> str | None:
        return html_of(self)
