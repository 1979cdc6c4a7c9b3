"""What has changed between fits, and how repeatable parameters are."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.stats

import identify
from hysteresis import InputError, Record
from hysteresis.internal import force_path
from hysteresis.rigs import SpongeRig
from identify import FitResult, change, pool
from identify.comparison._pooling import population_draws
from identify.internal import repeatability
from tests.refusals import refuses
from tests.test_identify.lines import line, pressed

NEW, AGED = (1.2, 5.4), (1.298, 6.186)
"""K (mm/N) and b (mm) of a sponge, and after six months: Tsuji 2014's line of the aged one."""


def test_a_sponge_and_the_same_six_months_later() -> None:
    before, after = line(*pressed(*NEW, seed=0)), line(*pressed(*AGED, seed=1))
    found = change(before, after)
    K, b = found.parameters
    # The errors of either are a few thousandths of K, and a hundredth of b.
    assert K.difference == pytest.approx(0.098, abs=4 * K.error)
    assert b.difference == pytest.approx(0.786, abs=4 * b.error)
    assert K.clear
    assert b.clear
    assert K.increased > 0.99
    assert found.left_out == {"threshold": "fixed"}
    assert found.words[0].startswith("The specimen has changed")
    assert found.words[1].startswith("K rose from 1.198 to 1.299 mm / N")
    assert found.words[-1] == "Not tested: threshold (fixed)."
    again = change(before, line(*pressed(*NEW, seed=2)))
    assert again.p > 0.01
    assert again.words[0].startswith("No significant change")
    by = again.parameters[0].difference
    assert again.words[1].startswith(f"K: no significant change ({by:+.3g} ± ")


def test_what_cannot_be_compared_is_refused() -> None:
    before, after = line(*pressed(*NEW, seed=0)), line(*pressed(*AGED, seed=1))
    fixed = line(*pressed(*AGED, seed=1), slope=1.2)
    assert change(before, fixed).left_out == {"K": "fixed", "threshold": "fixed"}
    K, *others = after.parameters
    in_metres = replace(after, parameters=(K._replace(unit="m / N"), *others))
    assert change(before, in_metres).left_out["K"] == "in m / N and mm / N"
    with pytest.raises(InputError, match="same rows"):
        change(before, before)
    refuses("bad-option", lambda: change(before, after, margin=5), "below 1")
    with pytest.raises(InputError, match="2 fits but 1 posteriors"):
        change(before, after, posteriors=[None])
    with pytest.raises(InputError, match="no fit has a parameter 'E1'; they have K, b, threshold"):
        pool([before, after], ["E1"])
    with pytest.raises(InputError, match="no parameter is known in every fit"):
        pool([before, after], ["threshold"])
    refuses("too-few-fits", lambda: pool([before]), "give two or more")


# Several specimens


def cells(low: float, high: float, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes of a quadrature in the logarithm, and their weights."""
    x = np.geomspace(low, high, count)
    return x, x * np.log(high / low) / count


def by_quadrature(
    z: np.ndarray, V: np.ndarray, prior: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Weights of every pair of taus, those taus, and mean and covariance of mu given them: two numbers."""
    (a, wa), (b, wb) = (cells(1e-3, 300 * p, 90) for p in prior)
    tau = np.stack(np.meshgrid(a, b, indexing="ij"), -1).reshape(-1, 2)
    weight = np.outer(wa / (1 + (a / prior[0]) ** 2), wb / (1 + (b / prior[1]) ** 2)).ravel()
    log_density, means, covariances = np.empty(len(tau)), [], []
    for k, scatter in enumerate(tau):
        A = np.linalg.inv(V + np.diag(scatter**2))
        M = A.sum(0)
        mean = np.linalg.solve(M, np.einsum("sij,sj->i", A, z))
        r = z - mean
        log_density[k] = (np.linalg.slogdet(A)[1].sum() - np.linalg.slogdet(M)[1]) / 2
        log_density[k] -= np.einsum("si,sij,sj->", r, A, r) / 2
        means.append(mean)
        covariances.append(np.linalg.inv(M))
    weight = weight * np.exp(log_density - log_density.max())
    return weight / weight.sum(), tau, np.array(means), np.array(covariances)


def test_pooling_agrees_with_quadrature() -> None:
    """Two numbers whose errors are correlated, five specimens; 16,000 draws."""
    random = np.random.default_rng(1)
    root = random.normal(size=(5, 2, 2)) * 0.1 + [[0.2, 0.15], [0.0, 0.1]]
    V = root @ root.transpose(0, 2, 1)
    z = random.multivariate_normal([0.3, -0.5], np.diag([0.09, 0.01]), 5)
    z = z + np.array([random.multivariate_normal([0, 0], v) for v in V])
    prior = np.array([0.5, 0.5])
    found = population_draws(np.broadcast_to(z, (16, 5, 2)), V, prior, 1000, random)
    weight, tau, means, covariances = by_quadrature(z, V, prior)
    for k in range(2):
        for place in (-0.1, 0.2, 0.5):
            deviation = np.sqrt(covariances[:, k, k])
            exact = weight @ scipy.stats.norm.cdf((place - means[:, k]) / deviation)
            # Draws of tau are correlated over two sweeps or so: 0.5 / sqrt(16000 / 3), four times.
            assert (found.mean[..., k] < place).mean() == pytest.approx(exact, abs=0.03)
            exact = weight @ (tau[:, k] < abs(place))
            assert (found.tau[..., k] < abs(place)).mean() == pytest.approx(exact, abs=0.03)
            spread = np.sqrt(deviation**2 + tau[:, k] ** 2)
            exact = weight @ scipy.stats.norm.cdf((place - means[:, k]) / spread)
            new = found.mean[..., k] + found.tau[..., k] * random.normal(size=(16, 1000))
            assert (new < place).mean() == pytest.approx(exact, abs=0.03)
    # The specimens: their mean given mu and tau is exact, so only the outer average is drawn.
    A = np.linalg.inv(V + tau[:, None, :, None] ** 2 * np.eye(2))
    gain = (tau[:, None, :, None] ** 2 * np.eye(2)) @ A
    centre = means[:, None] + np.einsum("ksij,ksj->ksi", gain, z - means[:, None])
    np.testing.assert_allclose(
        found.specimens.mean((0, 1)), np.einsum("k,ksi->si", weight, centre), atol=0.01
    )


def test_specimens_are_drawn_to_the_mean_as_far_as_their_data_leave_open() -> None:
    values = [(1.1, 5.0), (1.2, 5.5), (1.25, 5.3), (1.3, 6.0)]
    fits = [line(*pressed(*v, seed=k, noise=3.0)) for k, v in enumerate(values)]
    found = pool(fits)
    K, b = found.parameters
    assert (K.name, K.unit, b.unit) == ("K", "mm / N", "mm")
    assert found.left_out == {"threshold": "fixed"}
    assert found.new.shape == (4000, 2)
    assert found.specimens.shape == (4000, 4, 2)
    assert found.words[0].startswith("K: mean 1.2")
    assert found.words[-1] == "Not pooled: threshold (fixed)."
    assert K.new.low < K.mean.low < K.mean.value < K.mean.high < K.new.high
    # The other way round the draws are others; 4,000 of them, and the interval's ends its tails.
    mixed = pool(fits[::-1], ["b", "K"])
    other_b, other_K = mixed.parameters
    width = K.mean.high - K.mean.low
    assert other_K.mean.value == pytest.approx(K.mean.value, abs=0.05 * width)
    assert other_K.specimens[0].value == pytest.approx(K.specimens[-1].value, abs=0.05 * width)
    assert other_b.spread.value == pytest.approx(b.spread.value, rel=0.1)
    np.testing.assert_array_equal(pool(fits).new, found.new)
    # Alone; together with b a specimen moves along what its data cannot tell of the two.
    (alone,) = pool(fits, ["K"]).parameters
    own = np.array([fit["K"].value for fit in fits])
    shrunk = np.array([s.value for s in alone.specimens])
    assert np.all(np.diff(shrunk) > 0)
    assert np.all(np.abs(shrunk - alone.mean.value) < np.abs(own - alone.mean.value) + 0.01)
    assert np.ptp(shrunk) < np.ptp(own)


FORCE = force_path((0.0,) + (20.0, 0.0) * 5, 2.0)
CLEAN = SpongeRig().follow(FORCE, dt=6.0)
NOISE, PAIRS = 0.05, 8  # mm
LINE = {"model": "LinearSponge", "noise": "gaussian", "conditioning": "keep", "starts": 2}


def fitted(seed: int, softer: float = 1.0, cycles: int = 5) -> FitResult:
    rows = slice(0, 20 * cycles + 1)
    noise = np.random.default_rng(seed).normal(0, NOISE, len(FORCE))
    d = (softer * CLEAN + noise)[rows]
    record = Record.from_arrays(FORCE[rows], d, dt=6.0, input_unit="N", output_unit="mm")
    return identify.fit(record.select(range=(2.0, 20.0)), **LINE)


@pytest.fixture(scope="module")
def fits() -> list[FitResult]:
    return [fitted(seed) for seed in range(2 * PAIRS)]


def of_later_cycles(fit: FitResult) -> FitResult:
    """The same without the first cycle, in which the foam softens."""
    return identify.fit(fit.train.select(cycle=range(2, 6)), **LINE)


@pytest.mark.thorough
def test_the_errors_are_those_of_repeated_records(fits: list[FitResult]):
    """Noise of 0.05 mm makes K differ from record to record; the misfit of millimetres does not."""
    later = [of_later_cycles(fit) for fit in fits]
    spread = np.std([fit.parameters[0].value for fit in later], ddof=1)
    told = np.mean([repeatability(fit).stderr[0] for fit in later])
    # 16 records give their deviation to 18 %, 16 times 3 degrees of freedom the other to 10 %.
    assert told == pytest.approx(spread, rel=0.6)
    assert later[0].parameters[0].stderr > 20 * told


def test_ageing_is_seen_and_nothing_else(fits: list[FitResult]):
    """The line misses the loops by 2 mm in every record; 5 per cent softer is 0.07 mm/N."""
    same = [identify.change(fits[2 * k], fits[2 * k + 1]).p for k in range(PAIRS)]
    assert min(same) > 0.01 / PAIRS
    aged = identify.change(of_later_cycles(fits[0]), of_later_cycles(fitted(99, softer=1.05)))
    assert aged.p < 0.01
    # All probabilities are Student's: four cycles each are six degrees of freedom.
    assert [p.increased for p in aged.parameters] == pytest.approx(
        [1 - p.p / 2 if p.difference > 0 else p.p / 2 for p in aged.parameters], abs=1e-12
    )
    assert aged.parameters[0].name == "K"
    assert aged.parameters[0].clear
    assert aged.parameters[0].difference == pytest.approx(
        0.05 * fits[0].parameters[0].value, rel=0.1
    )


def test_parameters_carry_both_errors(fits: list[FitResult], tmp_path: Path):
    """Through save and load."""
    found = identify.load(identify.save(fits[0], tmp_path / "fit"))
    told = repeatability(fits[0])
    assert [p.repeatability for p in found.parameters if p.status == "free"] == told.stderr.tolist()
    assert "from cycle to cycle" in found.summary()
    assert fitted(3, cycles=2).parameters[0].repeatability is None
