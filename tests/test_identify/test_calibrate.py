"""Calibration of a system: linear algebra where it can, recovery away from the truth, coverage."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array

from hysteresis import InputError, parameter
from identify.internal import calibrate, choose
from tests.refusals import refuses


class Gauge(eqx.Module):
    """y = matrix u + offset, and what it takes to bend it: gain > 0."""

    matrix: Any = parameter(meaning="of the channels")
    offset: Any = parameter(0.0, meaning="of all")
    gain: Any = parameter(1.0, bounds=(0.0, float("inf")), meaning="saturation")


class Readings(eqx.Module):
    """Residuals over their noise's deviation."""

    u: Array
    y: Array
    sigma: float

    def __call__(self, gauge: Gauge) -> Array:
        linear = self.u @ gauge.matrix.T + gauge.offset
        return (jnp.tanh(gauge.gain * linear) / gauge.gain - self.y) / self.sigma


class Linear(Readings):
    def __call__(self, gauge: Gauge) -> Array:
        return (self.u @ gauge.matrix.T + gauge.offset - self.y) / self.sigma


def truth() -> Gauge:
    return Gauge(np.array([[1.1, -0.2], [0.1, 0.8]]), 0.3, 0.7)


def readings(kind: type[Readings], seed: int, rows: int = 30, sigma: float = 0.02) -> Readings:
    random = np.random.default_rng(seed)
    u = jnp.asarray(random.uniform(-1, 1, (rows, 2)))
    clean = -kind(u, jnp.zeros((rows, 2)), 1.0)(truth())
    return kind(u, -clean + sigma * random.normal(size=(rows, 2)), sigma)


START = Gauge(np.eye(2), 0.0, 1.0)


def test_linear_systems_have_the_posterior_of_linear_algebra():
    data = readings(Linear, 0)
    found = calibrate(START, data, {"matrix": 0.3, "offset": 1.0})
    # Columns of the design: four of the matrix, one of the offset; noise 0.02, prior 0.3 and 1.
    design, u = np.zeros((60, 5)), np.asarray(data.u)
    design[::2, 0:2], design[1::2, 2:4], design[:, 4] = u, u, 1.0
    prior = np.diag([0.3**-2] * 4 + [1.0])
    precision = design.T @ design / 0.02**2 + prior
    mean = np.array([1.0, 0, 0, 1, 0])
    right = design.T @ np.asarray(data.y).ravel() / 0.02**2 + prior @ mean
    best, covariance = np.linalg.solve(precision, right), np.linalg.inv(precision)
    assert found.converged
    assert [p.name for p in found.parameters] == [
        "matrix[0, 0]", "matrix[0, 1]", "matrix[1, 0]", "matrix[1, 1]", "offset",
    ]  # fmt: skip
    # 1e-7: where the search stops, in deviations of the prior.
    assert np.array([p.value for p in found.parameters]) == pytest.approx(best, abs=1e-7)
    deviations = np.sqrt(np.diag(covariance))
    assert np.array([p.deviation for p in found.parameters]) == pytest.approx(deviations, rel=1e-9)
    drawn = found.draws(4000, 1)
    spread = np.concatenate([np.asarray(drawn.matrix).reshape(-1, 4).std(0), [drawn.offset.std()]])
    # Of 4,000 draws: 1 % each, five times that.
    assert spread == pytest.approx(deviations, rel=0.06)


def test_what_the_data_do_not_tell_keeps_its_prior_and_what_is_fixed_its_value():
    data = readings(Linear, 1)
    found = calibrate(START, data, {"matrix": [[0.3, 0.0], [0.3, 0.3]], "gain": 0.2})
    named = {p.name: p for p in found.parameters}
    assert named["gain"].value == pytest.approx(1.0)
    assert named["gain"].deviation == pytest.approx(0.2)
    assert named["matrix[0, 1]"][1:3] == (0.0, 0.0)
    assert found.system.offset == 0.0


def test_recovery_of_a_bent_system_with_true_deviations():
    z = []
    for seed in range(12):
        doubts = {"matrix": 1.0, "offset": 1.0, "gain": 0.5}
        found = calibrate(START, readings(Readings, seed), doubts)
        true = [1.1, -0.2, 0.1, 0.8, 0.3, 0.7]
        z.append([(p.value - x) / p.deviation for p, x in zip(found.parameters, true, strict=True)])
        assert found.rms == pytest.approx(1.0, abs=0.35)  # of 60 residuals: deviation 0.09
    # 72 z of which few are independent: their mean square is 1 to about 0.3.
    assert 0.5 < np.mean(np.square(z)) < 1.7


def test_emcee_agrees_with_laplace():
    found = calibrate(START, readings(Linear, 2), {"matrix": 0.3, "offset": 1.0})
    posterior = found.sample(steps=300, ensembles=2, seed=1)
    for one, summary in zip(found.parameters, posterior.summaries, strict=True):
        assert summary.name == one.name
        assert summary.mean == pytest.approx(one.value, abs=0.3 * one.deviation)
        assert summary.sd == pytest.approx(one.deviation, rel=0.2)
    assert posterior.model.matrix.shape[1:] == (2, 2)


def test_faults_say_what_to_do():
    data = readings(Linear, 0)
    with pytest.raises(InputError, match="one of matrix, offset, gain"):
        calibrate(START, data, {"matrx": 0.1})
    refuses("bad-deviation", lambda: calibrate(START, data, {"matrix": -0.1}), "none negative")
    with pytest.raises(InputError, match="not all finite"):
        calibrate(START, Linear(data.u, jnp.full_like(data.y, jnp.nan), 0.1), {"matrix": 0.1})
    with jax.enable_x64(False), pytest.raises(InputError):
        calibrate(START, data, {"matrix": 0.1})


def test_measurements_are_chosen_where_they_tell_most():
    u = jnp.asarray([[1.0, 0.0], [0.2, 0.0], [0.0, 1.0], [0.0, 0.5], [0.5, 0.5]])
    doubts = {"matrix": [[0.3, 0.3], [0.0, 0.0]]}

    def rows(gauge: Gauge) -> Array:
        return (u @ gauge.matrix.T)[:, :1] / 0.02

    found = choose(START, rows, lambda gauge: gauge.matrix[0], doubts, 3)
    assert found.chosen.tolist()[:2] in ([0, 2], [2, 0])  # the longest lever for either number
    # After one of each: 1 / (1/0.3^2 + 1/0.02^2) of both; nothing before: 0.3.
    left = (0.3**-2 + 0.02**-2) ** -0.5
    assert found.expected[[0, 2]] == pytest.approx([0.3, left])
    # What is expected is what a calibration by these says.
    y = np.asarray(u @ START.matrix.T)
    used = Linear(u[found.chosen[:2]], jnp.asarray(y[found.chosen[:2]]), 0.02)
    parts = calibrate(START, used, doubts).parameters[:2]
    assert [p.deviation for p in parts] == pytest.approx([left, left], rel=1e-6)
