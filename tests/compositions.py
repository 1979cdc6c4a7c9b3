"""Models made of models, and the parts that compositions are fitted with, as problems."""

import numpy as np

from hysteresis import (
    AbstractModel,
    Burgers,
    LinearSponge,
    MonotoneCurve,
    NonlinearMaxwell,
    Scaled,
    Series,
    Softening,
    Sum,
)

LOW, HIGH = -1.0, 2.0
CELLS = 5
TIMES = np.array([0.1, 1.0, 10.0])
Known = tuple[np.ndarray, np.ndarray, np.ndarray]


def nonlinear_maxwell(rng: np.random.Generator, leading: bool = True) -> NonlinearMaxwell:
    """Strengths that hardly change with the level, so that the output rises with the input."""
    strengths = rng.uniform(0.5, 1.0, (3, 1)) * rng.uniform(0.99, 1.01, (3, CELLS + 1))
    springs = rng.uniform(0.1, 1.0, (3, CELLS))
    if not leading:
        strengths = 0.01 * strengths
    return NonlinearMaxwell(LOW, HIGH, TIMES, springs, strengths, leading=leading)


def softening(rng: np.random.Generator, leading: bool = True) -> Softening:
    """Beyond the inputs of the histories, lest the last cell's flat end is reached."""
    return Softening(LOW, HIGH + 1, rng.uniform(0.1, 0.5, (CELLS, CELLS)), 3.0, leading=leading)


def added(rng: np.random.Generator) -> Sum:
    line = LinearSponge(rng.uniform(0.5, 2), rng.normal())
    return Sum([line, nonlinear_maxwell(rng, leading=False), softening(rng, leading=False)])


def in_series(rng: np.random.Generator) -> Series:
    curve = MonotoneCurve.even(LOW, HIGH, rng.uniform(0.1, 1.0, CELLS), rng.normal())
    return Series([curve, Burgers(*rng.uniform(1, 40, 4)), LinearSponge(rng.uniform(0.5, 2))])


def scaled(rng: np.random.Generator) -> Scaled:
    return Scaled(Burgers(*rng.uniform(1, 40, 4)), -rng.uniform(0.5, 2), rng.normal())


MAKERS = {
    "nonlinear-maxwell": nonlinear_maxwell, "softening": softening, "sum": added,
    "series": in_series, "scaled": scaled,
}  # fmt: skip


def held(model: AbstractModel) -> Known:
    """A jump to an input that then stays."""
    t = np.concatenate([[0.0], np.cumsum(np.geomspace(1e-3, 2.0, 40))])
    u = np.full_like(t, 0.83)
    return t, u, _held(model, t, 0.83)


def _held(model: AbstractModel, t: np.ndarray, u: float) -> np.ndarray:
    if isinstance(model, Scaled):
        return float(model.offset) + float(model.factor) * _held(model.inner, t, u)
    if isinstance(model, Sum):
        return np.sum([_held(part, t, u) for part in model.parts], 0)
    if isinstance(model, Series):
        curve, burgers, line = model.parts
        assert isinstance(curve, MonotoneCurve)
        assert isinstance(line, LinearSponge)
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
    assert isinstance(model, NonlinearMaxwell)
    nodes = np.linspace(model.low, model.high, CELLS + 1)
    springs = np.pad(np.cumsum(np.asarray(model.increments), 1), ((0, 0), (1, 0)))
    g = np.array([np.interp(u, nodes, row) for row in springs])
    c = np.array([np.interp(u, nodes, row) for row in np.asarray(model.strengths)])
    c = c * (u - model.low) / (model.high - model.low)
    left = np.exp(-t[:, None] / TIMES)
    return (left * (g + c) if model.leading else g - left * (g + c)).sum(1)
