"""Creep and relaxation, an input that is held and an output that goes on moving; moduli over frequency."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float

from hysteresis import InputError, Note, Record, parameters
from hysteresis.numerics._functions import NORMAL_95
from hysteresis.records._abstract_record import kind_of_units

from .._levels import MUCH, SOME_ROWS, SURE, UNCERTAIN
from ..diagnostics._residual_breakdown import extrapolation
from ..noise._residual_statistics import estimate_noise
from ..records._folds import block_errors, parts
from ..results._detail import DiscreteSpectrum, Parametric
from ..results._fit_result import FitResult, Parameter, Status
from ..results._goodness_of_fit import Metrics, metrics
from ..spectra._extrapolation import CONFIDENCE
from ..spectra._of_record import answers_on, is_moduli, is_survey, responses_of, sizes_of, weighed
from ..spectra._prony_series import Input, Kind, Way
from ..spectra._response import Response
from ..spectra._spectrum import Answer, Order, Spectrum, spectrum
from ..spectra._superposition import Shifts, master_curve
from ._baselines import baselines_of_hold
from ._verdict import check_purpose, judge

# Creep or relaxation: what is held, by the units of input and output.


def kind_of(record: Record) -> Kind:
    """Creep or relaxation, by `kind_of_units`, else by whether the output goes on as the step did.

    Raises `InputError` where the output is on the other side of zero, does not move, or moves in the
    direction in which what is held cannot drive it.
    """
    if is_moduli(record):
        return "relaxation"
    rows = counted(record)
    y = record.output[rows] / record.input[rows]
    if is_survey(record):
        return kind_of_units(record) or ("creep" if _grows(record, rows) else "relaxation")
    if len(y) < 8:
        raise InputError(
            "too-few-rows",
            f"{len(y)} rows count: a spectrum needs at least 8.",
            place=record.source,
        )
    if np.median(y) <= 0:
        raise InputError(
            "not-a-step",
            f"{record.output_name} is on the other side of 0 than the step.",
            place=record.source,
            cause="the sign convention of one of them.",
            fix="turn the step's sign (--step VALUE).",
        )
    tenth = -(-len(y) // 10)
    change = float(np.median(y[-tenth:]) - np.median(y[:tenth]))
    noise = record.summary()["output"]["noise"] / abs(record.input[-1])
    if abs(change) <= SURE * noise:
        raise InputError(
            "no-excitation",
            f"{record.output_name} ends {abs(change * record.input[-1]):.3g} from where it began, about its"
            " noise: neither creep nor relaxation.",
            place=record.source,
            cause="the input was not held but its sensor is dead, or the test is too short.",
            fix="choose another column (--output COL), or measure for longer.",
        )
    moved: Kind = "creep" if change > 0 else "relaxation"
    told = kind_of_units(record)
    if told is not None and told != moved:
        moves = "grows" if change > 0 else "shrinks"
        raise InputError(
            "not-a-step",
            f"{record.output_name} {moves} by {abs(change * record.input[-1]):.3g} {record.output_unit}"
            f" while {record.input_name} is held: neither creep, in which a deformation grows, nor"
            " relaxation, in which a load falls.",
            place=record.source,
            cause="the input was still moving, the specimen swells, shrinks or recovers, or the sensor"
            " drifts.",
            fix="choose rows in which the input is held (--where), or fit the whole motion without --hold.",
        )
    return moved


def _grows(record: Record, rows: np.ndarray) -> bool:
    """Whether most outputs go on as the step did."""
    assert record.time is not None
    changes = [
        np.polyfit(
            record.time[at][rows[at]], record.output[at][rows[at]] / record.input[at][rows[at]], 1
        )[0]
        for _, at in record.sequences()
        if rows[at].sum() > 1
    ]
    return float(np.median(changes)) > 0


def told_by_the_change(record: Record, kind: Kind) -> tuple[Note, ...]:
    """A note that the change alone tells the kind, where the units do not."""
    if is_moduli(record) or kind_of_units(record) is not None:
        return ()
    way = "grows" if kind == "creep" else "shrinks"
    said = (
        f"Taken for {kind} because {record.output_name} {way}: the units ({record.input_unit} and"
        f" {record.output_unit}) do not say whether a load or a deformation is held."
    )
    return (Note("kind-by-change", said),)


def counted(record: Record) -> Bool[np.ndarray, " samples"]:
    """Rows that count and have an output."""
    return record.mask & np.isfinite(record.output)


AT_ONCE = 10
"""A clock that begins within so many of its median steps began with the load."""
FIRST_ROW = "step-at-first-row"
"""Code of the note that says so."""


def stepped(record: Record, at_first_row: bool | None = None) -> Record:
    """A record of one constant input from the clock's zero on, as a model has to see it.

    Rows before the last ones of a constant input are the way to a hold: they drive the model and do not
    count, and zero of the clock is where the hold begins.

    Where the step is before the first row, at zero of its clock, a row at zero is put before it, masked and
    without output: the input jumped there and not at the first reading. Where the step is at the first row,
    that becomes zero. Without `at_first_row` it is there if the clock begins late, more than ten of its
    median steps after zero, as a machine's clock does.

    Moduli over frequency, and steps at several temperatures, stay as they are.

    Raises `InputError` for an input that is 0 or not constant, several sequences, rows without a clock
    or from before the step.
    """
    place, t = record.source, record.time
    if is_survey(record):
        return record
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


def way_of(record: Record) -> Way | None:
    """The way to the hold of a record that `stepped` gave."""
    begin = _begin_of_hold(record)
    if not begin or is_survey(record):
        return None
    assert record.time is not None
    t, u = record.time[: begin + 1], record.input[: begin + 1] / record.input[-1]
    before = np.unique(np.append(0, np.geomspace(1, begin + 1, SOME_ROWS).astype(int) - 1))
    rows = begin - before[::-1]
    return Way(t[rows], u[rows])


def _begin_of_hold(record: Record) -> int:
    """The first of the last rows whose input is one constant."""
    moves = np.flatnonzero(record.input != record.input[-1:])
    return int(moves[-1]) + 1 if len(moves) else 0


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
    terms: int | None = None,
    tau: Sequence[float] | None = None,
    bounds: tuple[float, float] | None = None,
    fixed: Mapping[str, float] | None = None,
    progress: Callable[[str], None] | None = None,
) -> FitResult:
    """Fit a spectrum of time constants to creep or relaxation under an input that is held, or to moduli.

    The way to the hold, as the record shows it, drives the model (Boltzmann's superposition), and its rows
    are not fitted: there a material's stiffness may change with its strain. Without a way the load came at
    once.

    A deformation under a constant load creeps: `GeneralizedKelvinVoigt`. A load under a constant
    deformation relaxes: `GeneralizedMaxwell`. The units of input and output say which of them is held;
    where they do not, an output that rises is taken for creep, and a note says so. Errors are weighed by
    1 / sigma where the record has one, else by 1 / output. The model is a short series of time constants,
    or a dense spectrum where the rows call for one. See `spectrum`.

    **Arguments:**

    - `record`: one sequence with a clock, whose input is constant, or becomes so and stays; or moduli over
      frequency, see `hysid.records`. With a temperature as its condition every sequence is a run at one:
      their times are shifted onto each other, see `master_curve`.
    - `test`: a record to judge on; or `test_tail`, the last fraction of the rows: extrapolation.
    - `seed`: kept with the result; nothing here is random.
    - `purpose`: "predict" or "constants", see `fit`; constants are those of a short series.
    - `terms`, `tau`, `bounds`, `fixed`: a series of so many time constants, or of these, between those
      bounds, with known strengths, see `spectrum`.
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
    asked = {"terms": terms, "tau": tau, "bounds": bounds, "fixed": fixed}
    asked["dense"] = purpose != "constants"
    shifts = None
    if is_survey(record) and record.conditions:
        responses, temperatures = zip(*responses_of(record, kind, rows), strict=True)
        found, shifts = master_curve(responses, temperatures, **asked)
    elif is_moduli(record):
        ((response, _),) = responses_of(record, kind, rows)
        found = spectrum(response, **asked)
    else:
        assert record.time is not None
        y, way = record.output[rows] / record.input[rows], way_of(record)
        own = Response(record.time[rows], y, kind, way=way)
        found = spectrum(weighed(own, record, np.abs(record.input[rows]), rows), **asked)
    say(f"{kind}: {found.row.words}")
    detail = DiscreteSpectrum(found, shifts)
    fits = [
        _result(detail, row, answer, record, test, seed)
        for row, answer in zip(found.table, found.answers, strict=True)
    ]
    held = replace(record, mask=rows)
    judged_on = None if test is None else replace(test, mask=counted(test))
    baselines = () if is_survey(record) else baselines_of_hold(held, parts(held), judged_on)
    chosen = fits.pop(found.table.index(found.row))
    notes = (*found.notes, *told_by_the_change(record, kind))
    chosen = replace(chosen, notes=notes, detail=detail)
    chosen = replace(chosen, baselines=baselines, purpose=purpose)
    if test is not None:
        chosen = replace(chosen, extrapolation=extrapolation(chosen, chosen.predict(test)))
    told = (*(Note("spectrum", said) for said in found.notes), *_superposed(shifts))
    verdict = judge(chosen, told)
    if (covered := _coverage(found, test)) is not None:
        share, said = covered
        level = "CAUTION" if share < CONFIDENCE else "PASS"
        verdict = verdict.at_most(level, Note("open-range", said))
    chosen = replace(chosen, verdict=verdict)
    others = [
        replace(fit, detail=detail, baselines=baselines, purpose=purpose)
        for fit in sorted(fits, key=lambda fit: fit.score)
    ]
    others = [replace(fit, verdict=judge(fit), detail=Parametric()) for fit in others]
    return replace(chosen, candidates=(chosen, *others), seconds=time.perf_counter() - begin)


def _result(
    detail: DiscreteSpectrum,
    row: Order,
    answer: Answer,
    record: Record,
    test: Record | None,
    seed: int,
) -> FitResult:
    """One order as a fit."""
    found, rows, model = detail.spectrum, counted(record), answer.model
    residuals = np.where(rows, _outputs(detail, answer, record) - record.output, np.nan)
    figures: dict[str, Metrics | None] = {"test": None}
    figures["train"] = _figures(record, record.output + residuals, rows)
    test_blocks = None
    if test is not None:
        predicted, held_out = _outputs(detail, answer, test), counted(test)
        figures["test"] = _figures(test, predicted, held_out)
        error = test.weights * (predicted - test.output)
        test_blocks = np.array(block_errors(error[held_out]))
    listed, covariance = _parameters(found, row, answer, record)
    return FitResult(
        name=f"{type(model).__name__} {row.words}",
        model=model,
        parameters=listed,
        covariance=covariance,
        residuals=residuals,
        metrics=figures,
        success=True,
        score=float(100 * np.exp(row.evidence / (2 * found.noise.effective))),
        noise=estimate_noise([(record.weights * residuals)[rows]], row.parameters),
        train=record,
        test=test,
        test_blocks=test_blocks,
        used=rows,
        seed=seed,
    )


def _figures(record: Record, predicted: np.ndarray, rows: np.ndarray) -> Metrics:
    """Errors; of moduli the relative one is by what the fit weighs a row with. Under a sigma it is that of
    weighted errors over weighted readings."""
    found = metrics(record.output, predicted, rows, record.weights)
    sizes, w = sizes_of(record, rows)[rows], record.weights[rows]
    if record.sigma is not None:
        whole = found.rmse * np.sqrt(np.sum(w**2) / np.sum((w * sizes) ** 2))
        return found._replace(relative_percent=100 * float(whole))
    if not is_moduli(record):
        return found
    relative = (predicted - record.output)[rows] / sizes
    return found._replace(relative_percent=100 * float(np.sqrt(np.mean(relative**2))))


def _outputs(
    detail: DiscreteSpectrum, answer: Answer, record: Record
) -> Float[np.ndarray, " samples"]:
    """What the answer's model makes of the step or hold of a record, without compiling that anew for every
    order; NaN on the way there."""
    found = detail.spectrum
    if is_survey(record):
        return answers_on(record, found.kind, answer.fitted.outputs, detail.shifts)
    assert record.time is not None
    t, begin = record.time, _begin_of_hold(record)
    held = answer.fitted.outputs(Input(found.kind, t[begin:], None, way_of(record)))
    return np.append(np.full(begin, np.nan), record.input[begin:] * held)


def _parameters(
    found: Spectrum, row: Order, answer: Answer, record: Record
) -> tuple[tuple[Parameter, ...], Float[np.ndarray, "free free"]]:
    """Values with honest errors, and the covariance of the free ones.

    An element whose time is outside the record's is a spring or a dashpot: of its two numbers the one
    that this has is known.
    """
    model = answer.model
    units = record.input_unit, record.output_unit, record.time_unit
    words = model.unit_words(*(("1", units[1], "s") if is_moduli(record) else units))
    about = {name: (info.in_units(words), value) for name, info, value in parameters(model)}
    error = np.sqrt(np.diagonal(answer.covariance))
    tau = np.sort(1 / np.asarray(model.chain().rates))
    listed, values = [], []
    for k, name in enumerate(answer.names):
        field = name if name in about else name.rstrip("0123456789")
        number = int(name[len(field) :] or 0)
        unit, value = about[field]
        value = float(value[number - 1] if number else value)
        known = row.dense or 0 < error[k] < UNCERTAIN
        if number and not row.dense and not found.step < tau[number - 1] < found.span:
            slow = tau[number - 1] >= found.span
            known &= (field == "eta") == slow if found.kind == "creep" else field == "E" and slow
        status: Status = "free" if known else "unidentified"
        if error[k] == 0:
            known, status = False, "fixed"
        listed.append(Parameter(name, value, unit, value * error[k] if known else None, status))
        values.append(value)
    if found.kind == "relaxation" and "E_inf" not in answer.names:
        given: Status = "fixed" if answer.fitted.known[0] else "at bound"
        listed.append(Parameter("E_inf", 0.0, about["E_inf"][0], None, given))
    free = [k for k in range(len(values)) if listed[k].status == "free"]
    scale = np.array(values)[free]
    return tuple(listed), answer.covariance[np.ix_(free, free)] * scale[:, None] * scale


def _coverage(found: Spectrum, test: Record | None) -> tuple[float, str] | None:
    """How much of the held-out rows lies where the spectrum allows them, noise included; in words."""
    if test is None or is_survey(test):
        return None
    assert test.time is not None
    rows = counted(test)
    value, low, high = found._replace(way=way_of(test)).predict(test.time[rows])
    y, noise = test.output[rows] / test.input[rows], NORMAL_95 * found.noise.sigma * value
    share = float(np.mean((low - noise <= y) & (y <= high + noise)))
    last = test.time[rows][-1] / found.span
    said = (
        f"{100 * share:.0f} % of the held-out rows, up to {last:.3g} times the record's span, lie"
    )
    return share, f"{said} in the 90 % range of what the record leaves open."


def _superposed(shifts: Shifts | None) -> tuple[Note, ...]:
    """What one spectrum for all temperatures leaves over."""
    if shifts is None:
        return ()
    left, alone = (100 * float(np.sqrt(np.mean(part**2))) for part in (shifts.left, shifts.alone))
    worst = shifts.temperature[int(np.argmax(shifts.left))]
    said = (
        f"One spectrum shifted in time leaves {left:.2g} % of the reading, most at {worst:.4g} degC, and a"
        f" spectrum for each temperature {alone:.2g} %."
    )
    # Less is what the fewer numbers of one spectrum cost.
    if left > MUCH * alone:
        said = f"{said[:-1]}: the rest is beyond time-temperature superposition."
    return (Note("superposition", said, {"left": left, "alone": alone}),)
