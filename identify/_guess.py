"""Where a fit starts: a model of the right size for a record, read off the record itself."""

import numpy as np

from hysteresis import AbstractModel, Burgers, InputError, LinearSponge, Record, loop_direction

CANDIDATES = ("LinearSponge", "Burgers", "Preisach")
"""What `model="auto"` tries, the simplest first."""

CONTACT_FORCE = 1.5
"""Threshold of first contact in N (Tsuji 2014), used where the input is a force well above it."""


def guess(name: str, record: Record) -> AbstractModel:
    """A parametric model of this name with sizes taken from the record's ranges and times."""
    return {"LinearSponge": _sponge, "Burgers": _burgers}[name](record)


def _sponge(record: Record) -> LinearSponge:
    u, y = record.input[record.mask], record.output[record.mask]
    is_force = record.input_unit == "N" and u.min() < CONTACT_FORCE < 0.5 * u.max()
    threshold = CONTACT_FORCE if is_force else -np.inf
    K, b = np.polyfit(u[u >= threshold], y[u >= threshold], 1)
    return LinearSponge(K, b, threshold)


def _burgers(record: Record) -> Burgers:
    if record.time is None:
        raise InputError("no-time", "Burgers depends on the rate, and this record has no time.")
    u, y = record.input[record.mask], record.output[record.mask]
    leading = loop_direction(record) < 0
    gain = np.ptp(y) / np.ptp(u)
    stiffness = gain if leading else 1 / gain
    span = max(float(np.ptp(record.time[rows])) for _, rows in record.sequences())
    step = float(np.median(np.diff(record.time[next(iter(record.sequences()))[1]])))
    delay = np.sqrt(max(step, 1e-9 * span) * span)
    offset = float(y[0]) if leading else 0.0
    return Burgers(
        stiffness, 3 * stiffness * span, 2 * stiffness, 2 * stiffness * delay, offset,
        leading=leading,
    )  # fmt: skip


def orientations(record: Record) -> tuple[bool, ...]:
    """`leading` values worth trying: one where the loops tell their direction, else both."""
    direction = loop_direction(record)
    if abs(direction) > 0.3:
        return (direction < 0,)
    return False, True


def initial_states(record: Record) -> tuple[str, ...]:
    """Initial states worth trying: negative saturation alone where most sequences start low."""
    u = record.input
    first = u[record.starts]
    low, high = u[record.mask].min(), u[record.mask].max()
    if np.mean(first < low + 0.25 * (high - low)) > 0.5:
        return ("negative",)
    return "negative", "positive", "demagnetised"


def output_falls(record: Record) -> bool:
    """Whether the output falls, on the whole, as the input rises."""
    u, y = record.input[record.mask], record.output[record.mask]
    return bool(np.cov(u, y)[0, 1] < 0)
