"""Creep and relaxation: an input that is held, and an output that goes on moving."""

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from hysteresis import InputError, Note, Record, parameters
from hysteresis.numerics._normal import NORMAL_95

from ..diagnostics._rows_beyond import extrapolation
from ..noise._residual_statistics import estimate_noise
from ..records._folds import block_errors, parts
from ..results._detail import DiscreteSpectrum, Parametric
from ..results._fit_result import FitResult, Parameter, Status
from ..results._metrics import metrics
from ..spectra._extrapolation import CONFIDENCE
from ..spectra._prony_series import Input, Way
from ..spectra._spectrum import Answer, Order, Spectrum, spectrum
from ._baselines import baselines_of_hold
from ._creep_kind import counted, kind_of, told_by_the_change
from ._verdict import check_purpose, judge

AT_ONCE = 10
"""A clock that begins within so many of its median steps began with the load."""
FIRST_ROW = "step-at-first-row"
"""Code of the note that says so."""
NODES = 400
"""Rows of the way to a hold that its spectrum sees, the last ones densest: the rest is nearly forgotten."""
UNKNOWN = 2.0
"""A parameter whose logarithm is uncertain by more than this is not identified."""


def stepped(record: Record, at_first_row: bool | None = None) -> Record:
    """A record of one constant input from the clock's zero on, as a model has to see it.

    Rows before the last ones of a constant input are the way to a hold: they drive the model and do not
    count, and zero of the clock is where the hold begins.

    Where the step is before the first row, at zero of its clock, a row at zero is put before it, masked and
    without output: the input jumped there and not at the first reading. Where the step is at the first row,
    that becomes zero. Without `at_first_row` it is there if the clock begins late, more than ten of its
    median steps after zero, as a machine's clock does.

    Raises `InputError` for an input that is 0 or not constant, several sequences, rows without a clock
    or from before the step.
    """
    place, t = record.source, record.time
    if len(record.labels) > 1:
        raise InputError(
            "not-a-step",
            f"{len(record.labels)} sequences, and a step has one.",
            place=place,
            fix="choose one (--where COL=VALUE), or fit one for each value (--each COL).",
        )
    if t is None:
        raise InputError(
            "no-time",
            "creep and relaxation are told by the clock, and this record has none.",
            place=place,
            fix="name the time column (--time COL) or the sampling step (--dt SECONDS).",
        )
    begin = _begin_of_hold(record)
    if len(record) - begin < 2 or record.input[-1] == 0:
        raise InputError(
            "not-a-step",
            "the input of a step is one constant other than 0, to the last row.",
            place=place,
            fix="give the constant force or displacement (--step VALUE).",
        )
    if begin:
        way = f"{t[begin] - t[0]:.3g} {record.time_unit}"
        said = f"The way to the hold took {way}: it drives the model, and its {begin} rows are not fitted."
        if t[begin] == 0 and not record.mask[:begin].any():
            return record
        mask = record.mask & (np.arange(len(t)) >= begin)
        return record.noted("way-to-hold", said, time=t - t[begin], mask=mask)
    if t[0] < 0:
        raise InputError(
            "not-a-step",
            f"time begins at {t[0]:g}, before the step at 0.",
            place=place,
            fix="leave those rows out (--where), or count time from the step.",
        )
    if t[0] == 0:
        return record
    if at_first_row is None:
        at_first_row = len(t) > 1 and t[0] > AT_ONCE * float(np.median(np.diff(t)))
    if at_first_row:
        said = f"The step is taken at the first row, {t[0]:g} {record.time_unit} on its clock."
        return record.noted(FIRST_ROW, said, time=t - t[0])
    said = f"The step is at time 0, {t[0]:g} {record.time_unit} before the first row."
    return record.noted(
        "step-before-first-row",
        said,
        input=np.append(record.input[:1], record.input),
        output=np.append(np.nan, record.output),
        time=np.append(0.0, t),
        mask=np.append(False, record.mask),
        line=np.append(0, record.line),
        columns={name: np.append(x[:1], x) for name, x in record.columns.items()},
    )


def _begin_of_hold(record: Record) -> int:
    """The first of the last rows whose input is one constant."""
    moves = np.flatnonzero(record.input != record.input[-1:])
    return int(moves[-1]) + 1 if len(moves) else 0


def way_of(record: Record) -> Way | None:
    """The way to the hold of a record that `stepped` gave."""
    begin = _begin_of_hold(record)
    if not begin:
        return None
    assert record.time is not None
    t, u = record.time[: begin + 1], record.input[: begin + 1] / record.input[-1]
    before = np.unique(np.append(0, np.geomspace(1, begin + 1, NODES).astype(int) - 1))
    rows = begin - before[::-1]
    return Way(t[rows], u[rows])


def is_at_first_row(record: Record) -> bool:
    """Whether `stepped` took the first row of a record for the step."""
    return any(note.code == FIRST_ROW for note in record.history)


def fit_step(
    record: Record,
    *,
    test: Record | None = None,
    test_tail: float | None = None,
    seed: int = 0,
    purpose: str = "predict",
    allow_float32: bool = False,
    progress: Callable[[str], None] | None = None,
) -> FitResult:
    """Fit a discrete spectrum of time constants to creep or relaxation under an input that is held.

    The way to the hold, as the record shows it, drives the model (Boltzmann's superposition), and its rows
    are not fitted: there a material's stiffness may change with its strain. Without a way the load came at
    once.

    A deformation under a constant load creeps: `GeneralizedKelvinVoigt`. A load under a constant
    deformation relaxes: `GeneralizedMaxwell`. The units of input and output say which of them is held;
    where they do not, an output that rises is taken for creep, and a note says so. Errors are weighed by
    1 / output; the number of time constants is that of the greatest evidence. See `spectrum`.

    **Arguments:**

    - `record`: one sequence with a clock, whose input is constant, or becomes so and stays; see `stepped`.
    - `test`: a record to judge on; or `test_tail`, the last fraction of the rows: extrapolation.
    - `seed`: kept with the result; nothing here is random.
    - `purpose`: "predict" or "constants", see `fit`.
    - `allow_float32`: fit in the precision that JAX has, also where it is single.
    - `progress`: called with a line of text now and then.

    The result's candidates are the orders tried, best first; their `score` is the relative error in per
    cent, raised by what the evidence charges for parameters. `detail.spectrum` is the `Spectrum`
    of output / input, whose `predict` has the range that the record leaves open.

    Raises `InputError` where the record is no answer to a step.

    **Example:**

        >>> times = np.geomspace(0.1, 100, 60)
        >>> creep = hysteresis.Record.from_arrays(np.full(60, 2.0), 6 - 4 * np.exp(-times / 5), times)
        >>> identify.fit_step(creep).name
        'GeneralizedKelvinVoigt of order 1'
    """
    begin = time.perf_counter()
    say = progress or (lambda _: None)
    check_purpose(purpose)
    if test is not None and test_tail is not None:
        raise InputError("conflicting-options", "Give one of test and test_tail.")
    record = stepped(record)
    if test_tail is not None:
        record, test = record.split_tail(test_tail)
    elif test is not None:
        test = stepped(test)
    kind = kind_of(record)
    rows = counted(record)
    assert record.time is not None
    y, way = record.output[rows] / record.input[rows], way_of(record)
    found = spectrum(record.time[rows], y, kind, way=way)
    say(f"{kind}: {found.order} time constants of at most {len(found.table) - 1}")
    fits = [
        _result(found, row, answer, record, test, seed)
        for row, answer in zip(found.table, found.answers, strict=True)
    ]
    held = replace(record, mask=rows)
    judged_on = None if test is None else replace(test, mask=counted(test))
    baselines = baselines_of_hold(held, parts(held), judged_on)
    chosen = fits.pop(found.order)
    notes = (*found.notes, *told_by_the_change(record, kind))
    chosen = replace(chosen, notes=notes, detail=DiscreteSpectrum(found))
    chosen = replace(chosen, baselines=baselines, purpose=purpose)
    if test is not None:
        chosen = replace(chosen, extrapolation=extrapolation(chosen, chosen.predict(test)))
    verdict = judge(chosen, tuple(Note("spectrum", said) for said in found.notes))
    if (covered := _coverage(found, test)) is not None:
        share, said = covered
        level = "CAUTION" if share < CONFIDENCE else "PASS"
        verdict = verdict.at_most(level, Note("open-range", said))
    chosen = replace(chosen, verdict=verdict)
    others = [
        replace(fit, detail=DiscreteSpectrum(found), baselines=baselines, purpose=purpose)
        for fit in sorted(fits, key=lambda fit: fit.score)
    ]
    others = [replace(fit, verdict=judge(fit), detail=Parametric()) for fit in others]
    return replace(chosen, candidates=(chosen, *others), seconds=time.perf_counter() - begin)


def _result(
    found: Spectrum, row: Order, answer: Answer, record: Record, test: Record | None, seed: int
) -> FitResult:
    """One order as a fit."""
    rows, model = counted(record), answer.model
    residuals = np.where(rows, _outputs(found, answer, record) - record.output, np.nan)
    figures = {"train": metrics(record.output, record.output + residuals, rows), "test": None}
    test_blocks = None
    if test is not None:
        predicted, held_out = _outputs(found, answer, test), counted(test)
        figures["test"] = metrics(test.output, predicted, held_out)
        test_blocks = np.array(block_errors((predicted - test.output)[held_out]))
    listed, covariance = _parameters(found, answer, record)
    return FitResult(
        name=f"{type(model).__name__} of order {row.order}",
        model=model,
        parameters=listed,
        covariance=covariance,
        residuals=residuals,
        metrics=figures,
        success=True,
        score=float(100 * np.exp(row.evidence / (2 * found.noise.effective))),
        noise=estimate_noise([residuals[rows]], row.parameters),
        train=record,
        test=test,
        test_blocks=test_blocks,
        used=rows,
        seed=seed,
    )


def _outputs(found: Spectrum, answer: Answer, record: Record) -> Float[np.ndarray, " samples"]:
    """What the answer's model makes of the step or hold of a record, without compiling that anew for every
    order; NaN on the way there."""
    assert record.time is not None
    t, begin = record.time, _begin_of_hold(record)
    held = answer.fitted.outputs(Input(found.kind, t[begin:], None, way_of(record)))
    return np.append(np.full(begin, np.nan), record.input[begin:] * held)


def _parameters(
    found: Spectrum, answer: Answer, record: Record
) -> tuple[tuple[Parameter, ...], Float[np.ndarray, "free free"]]:
    """Values with honest errors, and the covariance of the free ones.

    An element whose time is outside the record's is a spring or a dashpot: of its two numbers the one
    that this has is known.
    """
    model = answer.model
    words = model.unit_words(record.input_unit, record.output_unit, record.time_unit)
    about = {name: (info.in_units(words), value) for name, info, value in parameters(model)}
    error = np.sqrt(np.diagonal(answer.covariance))
    tau = np.sort(1 / np.asarray(model.chain().rates))
    listed, values = [], []
    for k, name in enumerate(answer.names):
        field = name if name in about else name.rstrip("0123456789")
        number = int(name[len(field) :] or 0)
        unit, value = about[field]
        value = float(value[number - 1] if number else value)
        known = error[k] < UNKNOWN
        if number and not found.step < tau[number - 1] < found.span:
            slow = tau[number - 1] >= found.span
            known &= (field == "eta") == slow if found.kind == "creep" else field == "E" and slow
        status: Status = "free" if known else "unidentified"
        listed.append(Parameter(name, value, unit, value * error[k] if known else None, status))
        values.append(value)
    if found.kind == "relaxation" and "E_inf" not in answer.names:
        listed.append(Parameter("E_inf", 0.0, about["E_inf"][0], None, "at bound"))
    free = [k for k in range(len(values)) if listed[k].status == "free"]
    scale = np.array(values)[free]
    return tuple(listed), answer.covariance[np.ix_(free, free)] * scale[:, None] * scale


def _coverage(found: Spectrum, test: Record | None) -> tuple[float, str] | None:
    """How much of the held-out rows lies where the spectrum allows them, noise included; in words."""
    if test is None:
        return None
    assert test.time is not None
    rows = counted(test)
    value, low, high = found.predict(test.time[rows])
    y, noise = test.output[rows] / test.input[rows], NORMAL_95 * found.noise.sigma * value
    share = float(np.mean((low - noise <= y) & (y <= high + noise)))
    last = test.time[rows][-1] / found.span
    said = (
        f"{100 * share:.0f} % of the held-out rows, up to {last:.3g} times the record's span, lie"
    )
    return share, f"{said} in the 90 % range of what the record leaves open."
