"""The Prandtl-Ishlinskii model against plain play operators, a Preisach model, and its laws."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hysteresis import AbstractModel, InputError, PrandtlIshlinskii
from tests.problems import clock, histories
from tests.refusals import refuses

EPS = np.finfo(float).eps
LOW, HIGH = -3.0, 3.0
PLAYS = 4
seeds = st.integers(0, 2**32 - 1)
flags = st.booleans()
paths = histories(LOW, HIGH)


def draw(seed: int, leading: bool = False, bent: bool = False, rates: bool = False):
    rng = np.random.default_rng(seed)
    return PrandtlIshlinskii(
        np.cumsum(rng.uniform(0.1, 0.4, PLAYS)), rng.uniform(0.0, 1.0, PLAYS),
        rng.uniform(0.5, 2.0), rng.normal(), rates=rng.uniform(0, 0.02, PLAYS) if rates else None,
        bends=np.array([-1.5, 0.4, 2.0]) if bent else None,
        bend_slopes=rng.uniform(-0.3, 0.6, 3) if bent else None, leading=leading,
    )  # fmt: skip


@eqx.filter_jit
def simulate(model: AbstractModel, u: Any, t: Any = None) -> jax.Array:
    return model.simulate(t, u)


def output(model: AbstractModel, u: np.ndarray, t: np.ndarray | None = None) -> np.ndarray:
    return np.asarray(simulate(model, jnp.asarray(u), None if t is None else jnp.asarray(t)))


def rounding(model: PrandtlIshlinskii) -> float:
    """Sums over plays of parts no larger than the whole slope times the input, each rounded."""
    slope = float(model.slope) + float(model.weights.sum())
    bends = 1.0 if model.bend_slopes is None else 1.0 + float(jnp.abs(model.bend_slopes).sum())
    return 32 * EPS * (bends * slope * HIGH + abs(float(model.offset)))


def play_loop(model: PrandtlIshlinskii, t: np.ndarray, u: np.ndarray) -> np.ndarray:
    """The slow oracle: play by play, sample by sample."""
    x = float(model.slope) * u
    speed = np.append([0.0, 0.0], np.abs(np.diff(u) / np.diff(t)))[: len(u)]
    rates = np.zeros(PLAYS) if model.rates is None else np.asarray(model.rates)
    for r, w, c in zip(*map(np.asarray, (model.thresholds, model.weights)), rates, strict=True):
        z = 0.0
        for k in range(len(u)):
            width = r + c * speed[k]
            z = max(u[k] - width, min(u[k] + width, z))
            x[k] += w * (u[k] - z if model.leading else z)
    y = x + float(model.offset)
    if model.bends is not None:
        for d, s in zip(np.asarray(model.bends), np.asarray(model.bend_slopes), strict=True):
            y += s * (np.maximum(x - d, 0) if d >= 0 else np.minimum(x - d, 0))
    return y


@settings(max_examples=40)
@given(seed=seeds, u=paths, leading=flags, bent=flags, rates=flags)
def test_equal_to_a_loop_over_plays(seed, u, leading, bent, rates):
    model, t = draw(seed, leading, bent, rates), clock(seed)
    # Speeds of thousands move thresholds by tens: those are rounded too.
    tolerance = rounding(model) * (100 if rates else 1)
    np.testing.assert_allclose(output(model, u, t), play_loop(model, t, u), rtol=0, atol=tolerance)


@pytest.mark.parametrize(("code", "words", "change"), [
    ("parameter-out-of-bounds", "thresholds finite and increasing", {"thresholds": [1.0, 1.0]}),
    ("parameter-out-of-bounds", "thresholds above 0", {"thresholds": [0.0, 1.0]}),
    ("parameter-out-of-bounds", "weights at least 0", {"weights": [1.0, -0.1]}),
    ("parameter-out-of-bounds", "weights finite", {"weights": [1.0, np.nan]}),
    ("parameter-out-of-bounds", "slope above 0", {"slope": 0.0}),
    ("parameter-out-of-bounds", "rates at least 0", {"rates": [0.0, -1.0]}),
    ("length-mismatch", "thresholds and weights", {"weights": [1.0]}),
    ("length-mismatch", "thresholds and rates", {"rates": 1.0}),
    ("length-mismatch", "bends and bend_slopes", {"bends": [1.0]}),
    ("output-falls", "rise", {"bends": [0.0, 1.0], "bend_slopes": [-0.5, -0.5]}),
    ("output-falls", "rise", {"bends": [-1.0, -0.5], "bend_slopes": [-0.5, -0.6]}),
])  # fmt: skip
def test_what_is_refused(code: str, words: str, change: dict[str, Any]):
    good = {"thresholds": [0.5, 1.0], "weights": [1.0, 2.0], "slope": 1.0}
    PrandtlIshlinskii(**good)
    with pytest.raises(InputError, match=rf"{words}.*\[{code}\]"):
        PrandtlIshlinskii(**{**good, **change})


def test_times_are_checked_where_the_rate_matters():
    model, u = draw(0, rates=True), np.zeros(3)
    refuses("time-backwards", lambda: model.simulate([0.0, 1.0, 1.0], u))
    model.prepare([0.0, 1.0, 0.5], u, starts=(0, 2))


@given(seed=seeds, leading=flags, size=st.floats(0.0, 3.0))
def test_area_of_a_loop(seed: int, leading: bool, size: float):
    """Between -A and A play i encloses 4 w_i r_i (A - r_i) where A > r_i, counter-clockwise."""
    model = draw(seed, leading)
    r, w = np.asarray(model.thresholds), np.asarray(model.weights)
    # Straight from corner to corner, where the next play begins to move.
    down = np.concatenate([[size], size - 2 * np.minimum(r, size), [-size]])
    u = np.concatenate([[size], -down, down])
    y = output(model, u)[len(down) :]
    u = u[len(down) :]
    falling = -np.sum((y[1:] + y[:-1]) / 2 * np.diff(u))
    y = output(model, np.concatenate([[size], down, -down]))[len(down) :]
    rising = np.sum((y[1:] + y[:-1]) / 2 * -np.diff(u))
    area = (falling - rising) * (-1 if leading else 1)
    wanted = 4 * np.sum(w * r * np.maximum(size - r, 0))
    assert abs(area - wanted) <= 8 * rounding(model) * HIGH
