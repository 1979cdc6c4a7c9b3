"""Where fits of our own models start: sizes read off the record."""

import numpy as np

from ._model import needed_time
from ._quantities import FORCE, Units, conversion
from ._registry import register
from .models._bouc_wen import BoucWen, DegradingBoucWen
from .models._burgers import Burgers, StandardLinearSolid
from .models._curves import FoamCurve, LinearSponge
from .models._duhem import DuhemOperator
from .models._plays_and_stops import PrandtlIshlinskii
from .models._prony import GeneralizedKelvinVoigt, GeneralizedMaxwell
from .records._abstract_record import kind_of_units
from .records._excitation import loop_direction
from .records._record import Record

CONTACT_FORCE = 1.5
"""Threshold of first contact in N (Tsuji 2014), used where the input is a force well above it, and the
output none: a combination of channels has the output's unit."""


ENOUGH = 1000
"""Rows that tell which way a record lags."""


def _leads(record: Record) -> bool:
    """Whether a viscoelastic element runs deformation -> load, so that the output leads.

    The units tell where one is that of a load and the other that of a deformation, since moduli are loads
    over deformations. Else the sign of what lags does, which an input that goes one way shows too.
    """
    if (kind := kind_of_units(record)) is not None:
        return kind == "relaxation"
    return _lag(record) < 0


def _lag(record: Record) -> float:
    """b of y = a + c u + b L, L the input behind the delay that suits best: below 0 where y relaxes."""
    assert record.time is not None
    stride = -(-len(record) // ENOUGH)
    rows = np.union1d(np.arange(0, len(record), stride), record.starts)
    t, u = record.time[rows], record.input[rows]
    dt = np.diff(t, prepend=t[0])
    first = np.isin(rows, record.starts)
    step, span = float(np.median(dt[~first])), float(np.ptp(t))
    delays = np.geomspace(max(step, 1e-6 * span), max(span, 1e-6), 12)
    delayed = np.zeros((len(rows), len(delays)))
    for k in range(len(rows)):
        if first[k]:
            continue
        x = dt[k] / delays
        phi = -np.expm1(-x) / np.maximum(x, 1e-300)  # of an input that is linear between the rows
        delayed[k] = u[k] + np.exp(-x) * (delayed[k - 1] - u[k - 1]) - phi * (u[k] - u[k - 1])
    counted = record.mask[rows]
    best, lag = np.inf, 0.0
    for L in delayed.T:
        A = np.column_stack([np.ones(len(rows)), u, L])[counted]
        found = np.linalg.lstsq(A, record.output[rows][counted], rcond=None)[0]
        left = float(np.sum((A @ found - record.output[rows][counted]) ** 2))
        if left < best:
            best, lag = left, float(found[2])
    return lag


def _sponge(record: Record) -> LinearSponge:
    u, y = record.input[record.mask], record.output[record.mask]
    newtons = conversion(record.input_unit, FORCE)
    threshold = -np.inf
    if newtons is not None and conversion(record.output_unit, FORCE) is None:
        contact = CONTACT_FORCE / newtons
        threshold = contact if u.min() < contact < 0.5 * u.max() else threshold
    K, b = np.polyfit(u[u >= threshold], y[u >= threshold], 1)
    return LinearSponge(K, b, threshold)


def _burgers(record: Record, name: str = "Burgers") -> Burgers:
    time = needed_time(name, record.time, record.source)
    u, y = record.input[record.mask], record.output[record.mask]
    leading = _leads(record)
    gain = np.ptp(y) / np.ptp(u)
    stiffness = gain if leading else 1 / gain
    span = max(float(np.ptp(time[rows])) for _, rows in record.sequences())
    step = float(np.median(np.diff(time[next(iter(record.sequences()))[1]])))
    delay = np.sqrt(max(step, 1e-9 * span) * span)
    offset = float(y[0]) if leading else 0.0
    return Burgers(
        stiffness, 3 * stiffness * span, 2 * stiffness, 2 * stiffness * delay, offset,
        leading=leading,
    )  # fmt: skip


def _foam(record: Record) -> FoamCurve:
    """Toe, linear part and plateau of a quarter of the compressions each, the rest densification."""
    u, y = record.input[record.mask], record.output[record.mask]
    part = np.ptp(u) / 4
    toe_length = max(u.min() + part, 0.1 * part)
    stiffness = np.ptp(y) / np.ptp(u)
    return FoamCurve(stiffness, 0.5, 0.5, toe_length, part, part, part / 2, 1 / part, y[u.argmin()])


def _bouc_wen(record: Record) -> BoucWen:
    """Once it has yielded, the loss per way is the force of the yielding spring; the line is the rest."""
    u, y = record.input[record.mask], record.output[record.mask]
    across, gain = np.ptp(u), np.ptp(y) / np.ptp(u)
    loss = way = 0.0
    for _, rows in record.sequences():
        du, left = np.diff(record.input[rows]), record.output[rows] - gain * record.input[rows]
        counted = record.mask[rows][1:] & record.mask[rows][:-1]
        loss += abs(np.sum((du * (left[1:] + left[:-1]) / 2)[counted]))
        way += np.sum(np.abs(du[counted]))
    force = np.clip(loss / way, 0.02 * np.ptp(y), 0.45 * np.ptp(y))
    after = (np.ptp(y) - 2 * force) / across
    yield_at = 0.1 * across
    k = after + force / yield_at
    return BoucWen(k, after / k, yield_at, 1.5, 0.0, (y.max() + y.min()) / 2)


def _duhem(record: Record) -> DuhemOperator:
    """The record's slope, half as steep at one end of the output and one and a half times at the other."""
    u, y = record.input[record.mask], record.output[record.mask]
    gain = float(np.ptp(y) / np.ptp(u))
    after_turning = gain * np.linspace(0.5, 1.5, 5)
    rising = after_turning[::-1] if loop_direction(record) < 0 else after_turning
    return DuhemOperator(rising, rising[::-1], y.min(), y.max(), float(y[0] - gain * u[0]))


def _plays(record: Record) -> PrandtlIshlinskii:
    """Half of the record's slope in the line, the rest spread over plays of a part of its span each."""
    u, y = record.input[record.mask], record.output[record.mask]
    gain, half = np.ptp(y) / np.ptp(u), np.ptp(u) / 2
    widths = half * np.array([0.04, 0.12, 0.3, 0.6])
    leading = loop_direction(record) < 0
    return PrandtlIshlinskii(
        widths, np.full(4, gain / 8), gain / 2, float(np.mean(y) - gain * np.mean(u)),
        leading=leading,
    )  # fmt: skip


def _degrading(record: Record) -> DegradingBoucWen:
    """The new model, which loses a hundredth of strength and of stiffness for each energy of its yield."""
    return DegradingBoucWen(_bouc_wen(record), 0.01, 0.01)


def _solid(record: Record) -> StandardLinearSolid:
    """The spring and the delayed part of Burgers."""
    start = _burgers(record, "StandardLinearSolid")
    return StandardLinearSolid(start.E1, start.E2, start.eta2, start.offset, leading=start.leading)


def _creep_chain(record: Record) -> GeneralizedKelvinVoigt:
    """The spring of Burgers and two elements, a decade on either side of its delay."""
    start = _burgers(record, "GeneralizedKelvinVoigt")
    decade = np.sqrt(10.0) ** np.array([-1.0, 1.0])
    stiff = np.full(2, 2 * float(start.E2))
    return GeneralizedKelvinVoigt(
        start.E1, stiff, float(start.eta2) * decade, None, start.offset, leading=start.leading
    )


def _relaxation_chain(record: Record) -> GeneralizedMaxwell:
    """Two thirds of the record's slope in the spring, the rest in two elements."""
    start = _burgers(record, "GeneralizedMaxwell")
    u, y = record.input[record.mask], record.output[record.mask]
    gain, delay = float(np.ptp(y) / np.ptp(u)), float(start.eta2 / start.E2)
    leading = start.leading
    stiffness = gain if leading else 1 / gain
    offset = float(np.mean(y) - gain * np.mean(u)) if leading else 0.0
    decade = np.sqrt(10.0) ** np.array([-1.0, 1.0])
    return GeneralizedMaxwell(
        2 * stiffness / 3, np.full(2, stiffness / 6), delay * decade, offset, leading=leading
    )


register(LinearSponge, guess=_sponge)
register(Burgers, guess=_burgers)
register(FoamCurve, guess=_foam)
register(BoucWen, guess=_bouc_wen)
register(PrandtlIshlinskii, guess=_plays)
register(DuhemOperator, guess=_duhem)
register(DegradingBoucWen, guess=_degrading)
register(StandardLinearSolid, guess=_solid)
register(GeneralizedKelvinVoigt, guess=_creep_chain)
register(GeneralizedMaxwell, guess=_relaxation_chain)
register(Units)
