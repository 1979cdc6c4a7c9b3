"""Models made of models, and the parts that compositions are fitted with, as problems."""

from typing import Literal

import numpy as np

from hysteresis import (
    AbstractModel,
    BoucWen,
    Burgers,
    CyclicDrift,
    DegradingBoucWen,
    LinearSponge,
    Mixture,
    ModulatedStops,
    MonotoneCurve,
    NonlinearMaxwell,
    Pinching,
    Scaled,
    Series,
    Softening,
    Sum,
    TimeDrift,
    VelocityFriction,
)

LOW, HIGH = -1.0, 2.0
CELLS = 5
TIMES = np.array([0.1, 1.0, 10.0])
Known = tuple[np.ndarray, np.ndarray, np.ndarray]


def nonlinear_maxwell(rng: np.random.Generator, leading: bool = True) -> NonlinearMaxwell:
    """Strengths that hardly change with the level, so that the output rises with the input.

    Those of a lagging model differ after a rise and after a fall.
    """
    strengths = rng.uniform(0.5, 1.0, (3, 1)) * rng.uniform(0.99, 1.01, (3, CELLS + 1))
    springs = rng.uniform(0.1, 1.0, (3, CELLS))
    if not leading:
        strengths = 0.01 * np.stack([strengths, rng.uniform(0.9, 1.1) * strengths])
    rest = 0.3 * LOW + 0.7 * HIGH
    return NonlinearMaxwell(LOW, HIGH, TIMES, springs, strengths, leading=leading, rest=rest)


def softening(rng: np.random.Generator, leading: bool = True) -> Softening:
    """Beyond the inputs of the histories, lest the last cell's flat end is reached."""
    return Softening(LOW, HIGH + 1, rng.uniform(0.1, 0.5, (CELLS, CELLS)), 3.0, leading=leading)


def place_stops(rng: np.random.Generator) -> ModulatedStops:
    return _stops(rng, np.array([LOW, 0.3, HIGH]), "position")


def span_stops(rng: np.random.Generator) -> ModulatedStops:
    """No level is 0, the range of every first sample, where no output has a slope by it."""
    return _stops(rng, np.array([0.1, 1.0, HIGH - LOW]), "span")


def plays(rng: np.random.Generator) -> ModulatedStops:
    """Beside a spring; the same everywhere, of one level."""
    thresholds, springs = np.array([0.05, 0.3, 1.0]), rng.uniform(0.5, 1.0, 1)
    none, weights = np.zeros((3, 1)), rng.uniform(0.2, 0.6, (3, 1))
    return ModulatedStops(
        LOW, HIGH, thresholds, np.array([LOW]), none, springs, plays=weights, rest=0.2,
        by="position",
    )  # fmt: skip


def _stops(
    rng: np.random.Generator, levels: np.ndarray, by: Literal["position", "span"]
) -> ModulatedStops:
    """Changing little with the modulator, so that an error in it, of the sample before, does not grow."""
    thresholds = np.array([0.05, 0.3, 1.0])
    slopes = rng.uniform(0.5, 1.0, (3, 1)) * rng.uniform(0.9, 1.1, (3, 3))
    springs = rng.uniform(0.5, 1.0) * rng.uniform(0.9, 1.1, 3)
    return ModulatedStops(LOW, HIGH, thresholds, levels, slopes, springs, rest=0.2, by=by)


def friction(rng: np.random.Generator) -> Sum:
    """Beside a line and a warming zero: of friction alone the input is known but for a constant."""
    speeds, levels = np.array([0.1, 1.0]), np.array([LOW, 0.3, HIGH])
    weights = rng.uniform(0.1, 0.2, (2, 3))
    rest = rng.uniform(0.1, 0.2, 3)
    slider = VelocityFriction(LOW, HIGH, speeds, levels, weights, rest, smoothing=0.5)
    warming = TimeDrift(np.array([0.5, 20.0]), rng.normal(size=2))
    return Sum([LinearSponge(rng.uniform(0.5, 2)), slider, warming])


def drifting(rng: np.random.Generator) -> Sum:
    """Beside a line: a drift alone does not depend on the present input."""
    levels = np.array([LOW, 0.3, HIGH])
    drift = CyclicDrift(LOW, HIGH, levels, rng.uniform(-0.1, 0.1, 3), length=HIGH - LOW, least=0.4)
    return Sum([LinearSponge(rng.uniform(0.5, 2)), drift])


def added(rng: np.random.Generator) -> Sum:
    line = LinearSponge(rng.uniform(0.5, 2), rng.normal())
    return Sum([line, nonlinear_maxwell(rng, leading=False), softening(rng, leading=False)])


def in_series(rng: np.random.Generator) -> Series:
    curve = MonotoneCurve.even(LOW, HIGH, rng.uniform(0.1, 1.0, CELLS), rng.normal())
    return Series([curve, Burgers(*rng.uniform(1, 40, 4)), LinearSponge(rng.uniform(0.5, 2))])


def scaled(rng: np.random.Generator) -> Scaled:
    return Scaled(Burgers(*rng.uniform(1, 40, 4)), -rng.uniform(0.5, 2), rng.normal())


def mixed(rng: np.random.Generator) -> Mixture:
    return Mixture([in_series(rng), added(rng)], rng.uniform(0.2, 1, 2), rng.normal())


def degrading(rng: np.random.Generator) -> DegradingBoucWen:
    """Losing strength at half the speed at which the output could fall."""
    alpha = rng.uniform(0.05, 0.5)
    inner = BoucWen(rng.uniform(0.5, 2), alpha, rng.uniform(0.3, 1), 1.0, rng.uniform(-0.5, 0.9),
                    rng.normal())  # fmt: skip
    slip = Pinching(*rng.uniform(0.1, 0.6, 6))
    return DegradingBoucWen(inner, 0.5 * alpha / (1 - alpha), rng.uniform(0, 0.2), slip)


MAKERS = {
    "nonlinear-maxwell": nonlinear_maxwell, "softening": softening, "sum": added,
    "series": in_series, "scaled": scaled, "mixture": mixed, "friction": friction,
}  # fmt: skip


def held(model: AbstractModel) -> Known:
    """A jump to an input that then stays."""
    t = np.concatenate([[0.0], np.cumsum(np.geomspace(1e-3, 2.0, 40))])
    u = np.full_like(t, 0.83)
    return t, u, _held(model, t, 0.83)


def jumped(model: AbstractModel) -> Known:
    """From rest to an input that then stays: the modulator knows of it one sample later."""
    u = np.full(3, 1.7)
    by_position, gone = model.by == "position", 1.7 - model.rest
    before = [model.rest, 1.7, 1.7] if by_position else [0.0, gone, gone]
    slopes, springs = np.asarray(model.slopes), np.asarray(model.springs)
    strained = np.diff(np.minimum(gone, np.asarray(model.thresholds)), prepend=0.0)
    levels, thresholds = np.asarray(model.levels), np.asarray(model.thresholds)
    plays = np.zeros_like(slopes) if model.plays is None else np.asarray(model.plays)
    y = [
        np.interp(m, levels, springs) * gone
        + sum(np.interp(m, levels, w) * s for w, s in zip(slopes, strained, strict=True))
        + sum(
            np.interp(m, levels, p) * max(gone - r, 0)
            for p, r in zip(plays, thresholds, strict=True)
        )
        for m in before
    ]
    return u, u, np.array(y)


def _held(model: AbstractModel, t: np.ndarray, u: float) -> np.ndarray:
    if isinstance(model, Scaled):
        return float(model.offset) + float(model.factor) * _held(model.inner, t, u)
    if isinstance(model, Mixture):
        return _held(model.whole, t, u)
    if isinstance(model, Sum):
        return np.sum([_held(part, t, u) for part in model.parts], 0)
    if isinstance(model, Series):
        curve, burgers, line = model.parts
        y = np.append(0.0, np.cumsum(np.asarray(curve.increments)))
        v = float(curve.offset) + np.interp(u, np.asarray(curve.nodes), y)
        return float(line.K) * _held(burgers, t, float(v))
    if isinstance(model, LinearSponge):
        return np.full_like(t, float(model.K) * u + float(model.b))
    if isinstance(model, Burgers):
        return np.asarray(u * model.creep_compliance(t) + model.offset)
    if isinstance(model, Softening):
        n = model.weights.shape[0]
        r = np.clip((u - model.low) * n / (model.high - model.low) - np.arange(n), 0, 1)
        d = np.triu(np.asarray(model.weights))
        both = r[:, None] * (1 - r) + r if model.leading else r[:, None] * r
        return np.full_like(t, (d * both).sum())
    if isinstance(model, VelocityFriction | CyclicDrift):
        return np.zeros_like(t)  # a first sample has no velocity, and no path behind it
    if isinstance(model, TimeDrift):
        since = (t - t[0])[:, None]
        return (1 - np.exp(-since / np.asarray(model.times))) @ np.asarray(model.rates)
    nodes = np.linspace(model.low, model.high, CELLS + 1)
    springs = np.pad(np.cumsum(np.asarray(model.increments), 1), ((0, 0), (1, 0)))
    rest = model.low if model.rest is None else model.rest
    g, relaxed = (np.array([np.interp(x, nodes, row) for row in springs]) for x in (u, rest))
    # The strengths after a rise, or after a fall where there are two senses.
    strengths = np.asarray(model.strengths).reshape(-1, 3, CELLS + 1)[0 if u > rest else -1]
    c = np.array([np.interp(u, nodes, row) for row in strengths])
    moved = g - relaxed + c * (u - rest) / (model.high - model.low)
    left = np.exp(-t[:, None] / TIMES)
    return (left * moved if model.leading else g - left * moved).sum(1)
