"""A search for parameters: of records of many lengths it compiles few programs; skewed posteriors."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.optimize

from benchmarks._identification.calibration import deviates_of
from hysteresis import AbstractSteppedModel, Burgers, Record, StandardLinearSolid, parameter
from identify import fit
from identify.parametric._multistart import thinned_rows
from identify.parametric._standard_errors import Skewness, points_about, skewness
from tests.thorough import rest_thorough

compiled: list[str] = []
jax.monitoring.register_event_duration_secs_listener(
    lambda event, _, **about: compiled.append(f"{event} {about.get('fun_name')}")
)


def test_a_fit_of_another_length_finds_its_programs():
    def fitted(rows: int) -> None:
        u = np.sin(np.linspace(0, 20, rows))
        y = 2 * u + np.random.default_rng(rows).normal(0, 0.01, rows)
        fit(Record.from_arrays(u, y), "LinearSponge")

    fitted(130)
    compiled.clear()
    fitted(190)
    searches = ("levenberg_marquardt", "likeliest")
    assert not [one for one in compiled if "compile" in one and any(s in one for s in searches)]
    # The listener hears: the prediction is compiled.
    assert any("compile" in one for one in compiled)


def creep(rows: int) -> Record:
    """A solid that does not flow, under steps of force, and noise."""
    t = np.linspace(0.0, 60.0, rows)
    u = np.interp(t, np.linspace(0, 60, 13), [0, 5, 5, 5, 1, 1, 3, 3, 0.5, 4, 4, 2, 0])
    y = np.asarray(StandardLinearSolid(2.0, 1.0, 8.0, 0.3).simulate(t, u))
    noise = np.random.default_rng(rows).normal(0.0, 0.01, rows)
    return Record.from_arrays(u, y + noise, t)


@pytest.mark.parametrize("rows", rest_thorough([400, 4000], 1))
def test_a_parameter_that_goes_to_infinity_is_unidentified_and_the_fit_converges(rows: int):
    """In these records noise makes any flow a worse fit; the verdict does not depend on their length."""
    start, options = Burgers(1.0, 30.0, 2.0, 5.0), {"noise": "gaussian", "conditioning": "keep"}
    found = fit(creep(rows), start, starts=4, **options)
    about = {p.name: p for p in found.parameters}
    assert found.success
    assert (about["eta1"].status, about["eta1"].stderr) == ("unidentified", None)
    assert about["eta1"].value > 1e3
    assert [about[name].status for name in ("E1", "E2", "eta2", "offset")] == ["free"] * 4
    assert "not-converged" not in [reason.code for reason in found.verdict.reasons]


class Idle(AbstractSteppedModel[Any]):
    """A line, and a number that moves nothing."""

    slope: float = parameter(meaning="rise")
    idle: float = parameter(meaning="nothing")

    def init(self, t0: Any = None, u0: Any = None) -> Any:
        return jnp.zeros(())

    def step(self, state: Any, t: Any, u: Any) -> tuple[Any, Any]:
        return state, self.slope * u + 0 * self.idle


def test_what_a_record_does_not_tell_stays_where_the_first_start_has_it():
    u = np.sin(np.linspace(0, 20, 100))
    record = Record.from_arrays(u, 2 * u + np.random.default_rng(0).normal(0, 0.01, 100))
    found = fit(record, Idle(1.0, 3.0), starts=8, noise="gaussian")
    assert (found["idle"].status, float(found["idle"].value)) == ("unidentified", 3.0)


class Begun(AbstractSteppedModel[Any]):
    """The path so far, from a length on."""

    first: float = parameter(meaning="length at first")

    def init(self, t0: Any = None, u0: Any = None) -> Any:
        return jnp.asarray(self.first)

    def step(self, state: Any, t: Any, u: Any) -> tuple[Any, Any]:
        return state + jnp.abs(u), state


def test_a_first_state_that_is_a_parameter_is_found():
    u = np.sin(np.linspace(0, 20, 100))
    y = 3.0 + np.append(0.0, np.cumsum(np.abs(u))[:-1])
    noise = np.random.default_rng(0).normal(0, 0.01, 100)
    found = fit(Record.from_arrays(u, y + noise), Begun(1.0), noise="gaussian", conditioning="keep")
    assert float(found["first"].value) == pytest.approx(3.0, abs=0.01)


def test_the_optimum_is_that_of_another_solver():
    record = creep(400)
    start, options = StandardLinearSolid(1.0, 2.0, 5.0), {"noise": "gaussian", "starts": 1}
    found = fit(record, start, conditioning="keep", **options)
    names = ("E1", "E2", "eta2", "offset")

    def residuals(values: np.ndarray) -> np.ndarray:
        model = StandardLinearSolid(*values)
        return np.asarray(model.simulate(record.time, record.input)) - record.output

    values = np.array([found[name].value for name in names])
    other = scipy.optimize.least_squares(residuals, 1.1 * values, xtol=1e-14, ftol=1e-14)
    np.testing.assert_allclose(values, other.x, rtol=1e-6, atol=1e-6)


def test_thinned_rows_keep_the_turning_points():
    ends = np.random.default_rng(0).normal(size=201)
    u = np.interp(np.arange(50_000), np.arange(0, 50_001, 250), ends)
    rows, starts = thinned_rows(Record.from_arrays(u, u, groups=np.arange(50_000) >= 20_000), 1000)
    assert len(rows) < 1100
    assert rows[0] == 0
    assert starts == (0, int(np.searchsorted(rows, 20_000)))
    assert {rows[k] for k in starts} == {0, 20_000}
    turns = np.flatnonzero(np.diff(np.sign(np.diff(u)))) + 1
    # A block of a hundred rows holds one turning point at most, which is its least or its greatest.
    assert np.isin(turns, rows).all()
    assert len(thinned_rows(Record.from_arrays(u[:2000], u[:2000]), 1000)[0]) == 2000


SIZE, NINETY = 0.1, 1.6448536
AXIS = np.linspace(-1.0, 0.6, 200_001)
HEIGHT = np.exp(-((np.exp(AXIS) - 1) ** 2) / (2 * SIZE**2))
"""The posterior of z = log K, where K = 1 was measured with an error of `SIZE`."""


def score(z: np.ndarray) -> np.ndarray:
    return -(np.exp(z) - 1) * np.exp(z) / SIZE**2


def of_log() -> Skewness:
    covariance = np.array([[SIZE**2]])
    return skewness(score(points_about(np.zeros(1), covariance)), covariance)


def test_a_logarithm_has_the_quantiles_of_its_posterior() -> None:
    bent = of_log()
    # By hand: d3 log p / dz3 = -3 / SIZE^2. Differences of 0.7 deviations see its change, a few per cent.
    assert bent.shift[0] == pytest.approx(-1.5 * SIZE, rel=0.05)
    assert bent.skew[0] == pytest.approx(-3 * SIZE, rel=0.05)
    share = np.cumsum(HEIGHT) / HEIGHT.sum()
    for side, wanted in ((-NINETY, 0.05), (NINETY, 0.95)):
        end = SIZE * (side + bent.displaced(NINETY)[0])
        exact = np.interp(wanted, share, AXIS)
        # What is left is of third order, skew squared; without the skewness it is five times that.
        assert abs(end - exact) < 0.07 * SIZE
        assert abs(SIZE * side - exact) > 0.15 * SIZE
        # The inverse expansion is that of the ends.
        assert deviates_of(bent, np.array([end / SIZE]))[0] == pytest.approx(side, abs=1e-12)
