"""Whiteness, breakdown, sensitivity and sloppiness, against their laws."""

from dataclasses import replace
from typing import Any

import equinox as eqx
import numpy as np
import pytest
import scipy.stats

from hysteresis import Record, Scalar, parameter
from identify import FitResult, breakdown, fit, sensitivity, sloppiness, whiteness
from identify.fitting._verdict import judge
from identify.internal import estimate_noise
from identify.noise._model import NoiseModel
from tests.other_models import AbstractMemoryless
from tests.test_identify.lines import THRESHOLD, line, pressed

ROWS = 600


def triangle(rates: tuple[float, ...] = (1.0,)) -> np.ndarray:
    """As many rows of a triangle as there are, each part of them at its own rate."""
    steps = np.repeat(rates, ROWS // len(rates))
    return np.abs((np.cumsum(steps) / 50 + 1) % 2 - 1)


def with_residuals(r: np.ndarray, u: np.ndarray, noise: NoiseModel | None = None) -> FitResult:
    """A fit that left these residuals behind."""
    record = Record.from_arrays(u, -r, 0.1 * np.arange(len(u)), time_unit="s")
    plain = line(*pressed(1.0, 0.0, 0))
    return replace(
        plain, train=record, residuals=r, used=record.mask, noise_model=noise,
        noise=estimate_noise([r]),
    )  # fmt: skip


def coloured(random: np.random.Generator, phi: float, rows: int = ROWS) -> np.ndarray:
    """AR(1) of unit variance."""
    w = random.normal(size=rows) * np.sqrt(1 - phi**2)
    w[0] /= np.sqrt(1 - phi**2)
    for k in range(1, rows):
        w[k] += phi * w[k - 1]
    return w


@pytest.mark.thorough
@pytest.mark.parametrize("phi", [None, 0.5])
def test_white_noise_has_every_p_value_as_often(phi: float | None) -> None:
    """One-step-ahead errors too, under the noise that they have."""
    noise = None if phi is None else NoiseModel(1.0, phi=phi)
    p = []
    for seed in range(300):
        r = coloured(np.random.default_rng(seed), phi or 0.0)
        p.append(whiteness(with_residuals(r, triangle(), noise)).p_value)
    # phi is given and not fitted, so one degree of freedom is taken too many: p is a little low.
    lags = 20
    if phi is not None:
        p = list(scipy.stats.chi2.sf(scipy.stats.chi2.isf(p, lags - 1), lags))
    assert scipy.stats.kstest(p, "uniform").pvalue > 0.01


def test_coloured_residuals_are_not_white() -> None:
    for seed in range(20):
        found = whiteness(with_residuals(coloured(np.random.default_rng(seed), 0.5), triangle()))
        assert found.p_value < 1e-6
        assert not found.white
        assert "not white" in found.said[0]


def test_residuals_that_follow_the_speed_are_said_to() -> None:
    u = triangle((1.0, 2.0, 4.0))
    v = np.diff(u, prepend=u[0])
    r = v / v.std() + np.random.default_rng(0).normal(size=ROWS)
    found = whiteness(with_residuals(r, u))
    words = ("speed at lag 0", "rate dependence is missing")
    assert any(all(word in said for word in words) for said in found.said)
    # Where there is one rate its sign is the branch, and no more can be said.
    u = triangle()
    v = np.diff(u, prepend=u[0])
    noise = 0.5 * np.random.default_rng(0).normal(size=ROWS)
    found = whiteness(with_residuals(v / v.std() + noise, u))
    assert any("the loop's width is off" in said for said in found.said)


def test_the_parts_of_an_error_add_up_and_the_worst_is_found() -> None:
    u = triangle((1.0, 3.0))
    r = np.random.default_rng(0).normal(size=ROWS)
    r[u > 0.8] += 3.0
    found = breakdown(with_residuals(r, u))
    for kind in ("branch", "cycle", "rate", "input"):
        parts = found.of(kind)
        assert sum(part.rows for part in parts) == ROWS
        assert sum(part.share for part in parts) == pytest.approx(1.0)
        total = sum(part.rows * part.rmse**2 for part in parts)
        assert total == pytest.approx(np.sum(r**2))
        assert sum(part.rows * part.bias for part in parts) == pytest.approx(r.sum())
    assert found.said.startswith("Worst at inputs of 0.8 to 1:")
    assert "the model above the reading there" in found.said
    calm = breakdown(with_residuals(np.random.default_rng(1).normal(size=ROWS), u))
    assert calm.said.startswith("The error is spread evenly")


def test_what_a_line_is_without_a_cycle_is_the_line_through_the_others() -> None:
    """The likelihood's maximum for fixed rows is least squares, whatever sigma."""
    train, test = pressed(1.5, 2.0, 0)
    far = np.flatnonzero(train.input > 5)[7]
    output = train.output.copy()
    output[far] += 6.0  # twenty deviations
    found = sensitivity(line(replace(train, output=output), test))
    assert found.names == ("K", "b")
    # Five training cycles and the outlier.
    assert [case.said for case in found.cases] == [
        "the first cycle", "cycle 2", "cycle 3", "cycle 4", "cycle 5", "1 row beyond 4.1 deviations"
    ]  # fmt: skip
    for case, left_out in zip(
        found.cases, [*(train.cycle == k for k in range(1, 6)), np.arange(len(train)) == far],
        strict=True,
    ):  # fmt: skip
        rows = train.mask & (train.input >= THRESHOLD) & ~left_out
        exact = np.polyfit(train.input[rows], output[rows], 1)
        # Newton's last step leaves a gain of 1.5e-8: 2e-4 standard errors, of which b has 2 %.
        np.testing.assert_allclose(case.values, exact, rtol=1e-5)
        assert case.rows == (train.mask & left_out).sum()
    softer = np.where(train.cycle == 1, 1.2 * train.output, train.output)
    found = sensitivity(line(replace(train, output=softer), test))
    assert found.said[0].startswith("Without the first cycle, K moves by")


class InSeries(AbstractMemoryless):
    """Two springs in series, u = (1 / E1 + 1 / E2) F, and a dashpot that nothing moves."""

    E1: Scalar = parameter(unit="input / output", bounds=(0.0, float("inf")))
    E2: Scalar = parameter(unit="input / output", bounds=(0.0, float("inf")))
    c2: Scalar = parameter(unit="input * time / output", bounds=(0.0, float("inf")))
    at_all: bool = eqx.field(default=True, static=True)

    def evaluate(self, prepared: Any) -> Any:
        return (1 / self.E1 + 1 / self.E2 + 0.0 * self.c2) * prepared


@pytest.fixture(scope="module")
def in_series() -> FitResult:
    u = triangle()
    y = u * (1 / 2.0 + 1 / 3.0) + 0.01 * np.random.default_rng(0).normal(size=ROWS)
    record = Record.from_arrays(u, y, 0.1 * np.arange(ROWS), time_unit="s")
    return fit(record, InSeries(2.0, 3.0, 1.0), starts=2, noise="gaussian", conditioning="keep")


def test_springs_in_series_are_known_together_only(in_series: FitResult) -> None:
    found = sloppiness(in_series)
    # Two of three directions are not seen at all.
    assert found.condition == float("inf")
    assert found.eigenvalues[0] > 1e3
    assert (found.eigenvalues[1:] < 1e-6 * found.eigenvalues[0]).all()
    both = [d for d in found.directions if {"E1", "E2"} <= set(d.moves)]
    assert len(both) == 1
    (before, after), (other, less) = both[0].moves["E1"], both[0].moves["E2"]
    # What moves together leaves the sum of compliances as it is.
    assert 1 / after + 1 / less == pytest.approx(1 / before + 1 / other, rel=1e-3)
    assert abs(np.log(after / before)) > 0.2
    assert both[0].effect < 0.5
    assert "E1 can be" in both[0].said or "E2 can be" in both[0].said
    assert any("c2" in d.said and "A creep hold" in d.said for d in found.directions)


def test_a_parameter_without_effect_is_a_reason(in_series: FitResult) -> None:
    assert "without-effect" in in_series.verdict.codes
    said = [r for r in in_series.verdict.reasons if "[without-effect]" in r]
    assert said == [
        "c2 changes the fit by < 1e-06 of its range when doubled: fix it, or add a creep hold."
        " [without-effect]"
    ]


class Squared(AbstractMemoryless):
    """y = c^2 u: either sign of c fits as well."""

    c: Scalar = parameter(unit="1")

    def evaluate(self, prepared: Any) -> Any:
        return self.c**2 * prepared


def test_two_minima_that_fit_equally_well_are_a_reason() -> None:
    u = triangle()
    y = 2.25 * u + 0.01 * np.random.default_rng(0).normal(size=ROWS)
    record = Record.from_arrays(u, y, 0.1 * np.arange(ROWS), time_unit="s")
    found = fit(record, Squared(1.0), starts=2, noise="gaussian", conditioning="keep")
    ends = found.starts._replace(free=found.starts.free * np.array([[1.0], [-1.0]]))
    verdict = judge(replace(found, starts=ends, purpose="constants"))
    assert verdict.level == "CAUTION"
    said = verdict.reasons[verdict.codes.index("second-minimum")]
    c = float(found.parameters[0].value)
    assert c == pytest.approx(np.sqrt((u @ y) / (u @ u)), rel=1e-6)
    assert f"c {-c:.3g} or {c:.3g}." in said
    assert "second-minimum" not in found.verdict.codes
