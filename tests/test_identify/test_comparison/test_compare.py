"""Comparing models of one record, and a specimen before and after: signs, chance, criteria, evidence."""

from dataclasses import replace
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.stats

import identify
from hysteresis import InputError, LinearSponge, Record, StandardLinearSolid
from hysteresis.internal import force_path
from hysteresis.rigs import SpongeRig
from identify import FitResult, change, compare, fit, pool, save
from identify.comparison._pooling import population_draws
from identify.internal import Compared, Comparison, compare_candidates, repeatability, target
from tests.refusals import raises, refuses
from tests.test_identify.lines import line, pressed


def model(name: str, blocks: np.ndarray) -> Compared:
    return Compared(name, "LinearSponge", float(np.sqrt(blocks.mean())), None, 2, blocks=blocks)


def test_equal_models_are_told_apart_one_time_in_twenty() -> None:
    """Blocks of thirty rows: 2,000 pairs, so 0.05 to three times 0.005; the t is not quite one."""
    a, b = np.random.default_rng(0).chisquare(30, (2, 2000, 10))
    clear = []
    for one, other in zip(a, b, strict=True):
        pair = Comparison((model("a", one), model("b", other)), "held-out", ()).pairs[0]
        clear.append(pair.held_out.clear)
    assert 0.035 < np.mean(clear) < 0.065


def test_words_say_who_is_better_or_that_nobody_knows() -> None:
    good, noisy = np.full(10, 1.0), np.linspace(0.5, 1.5, 10)
    comparison = Comparison((model("a", good), model("b", 4 * good + 0.1 * noisy)), "held-out", ())
    assert comparison.words[0].startswith("a predicts held-out rows better than b by 1 ±")
    comparison = Comparison((model("a", good), model("b", noisy)), "held-out", ())
    assert comparison.words[0].startswith("a and b cannot be told apart on held-out rows (")
    bare = model("a", good)._replace(blocks=None)
    assert "no blocks to pair" in Comparison((bare, model("b", good)), "test", ()).words[0]


@pytest.fixture(scope="module")
def steep() -> tuple[FitResult, FitResult]:
    """A line, and one whose slope is a tenth too small."""
    train, test = pressed(1.3, 6.0, seed=0)
    return line(train, test), line(train, test, slope=1.17)


def test_fits_of_other_data_or_other_rows_are_refused(steep) -> None:
    free, given = steep
    other = line(*pressed(1.3, 6.0, seed=1))
    refuses("not-comparable", lambda: compare({"one": free, "two": other}), "do not compare")
    renamed = replace(free, train=replace(free.train, output_name="height"))
    with pytest.raises(InputError, match="one predicts displacement, two height"):
        compare({"one": free, "two": renamed})
    refuses("too-few-fits", lambda: compare([free]), "give two or more")
    # Fitted to fewer rows: the test record is still the same.
    fewer = replace(given, train=given.train.select(cycle=[3, 4, 5]))
    found = compare({"one": free, "two": fewer})
    assert found.ranked_on == "test"
    assert found.pairs[0].held_out is None
    assert "other training rows" in found.notes[0]
    with raises("not-comparable", "share no test record"):
        compare({"one": free, "two": replace(fewer, test=None)})


def test_evidence_is_the_integral_of_the_posterior(steep) -> None:
    """A grid over K, b and log sigma; Laplace's error is of the order of 1 / rows."""
    fitted = steep[0]
    about = target(fitted)
    curvature = -np.asarray(jax.jit(jax.hessian(about.log_probability))(about.start))
    root = np.linalg.cholesky(np.linalg.inv(curvature))
    axis = np.linspace(-6, 6, 25)  # half a deviation: of a near Gaussian exact to 1e-8
    grid = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), -1).reshape(-1, 3)
    points = jnp.asarray(np.asarray(about.start) + grid @ root.T)
    heights = np.asarray(jax.jit(jax.vmap(about.log_probability))(points))
    volume = (axis[1] - axis[0]) ** 3 * abs(np.linalg.det(root))
    exact = scipy.special.logsumexp(heights) + np.log(volume)
    models = compare({"free": fitted, "given": steep[1]}).models
    (found,) = (one for one in models if one.name == "free")
    assert found.log_evidence == pytest.approx(exact, abs=0.03)


def test_candidates_and_folders_of_real_fits(tmp_path) -> None:
    train, test = pressed(1.3, 6.0, seed=0)
    options = {"test": test, "starts": 2, "noise": "gaussian", "conditioning": "keep"}
    first = fit(train, "LinearSponge", **options)
    later = fit(train, LinearSponge(K=1.3, b=6.0, threshold=8.0), **options)
    save(first, tmp_path / "at first contact")
    save(later, tmp_path / "from 8 N")
    found = compare([tmp_path / "at first contact", tmp_path / "from 8 N"])
    assert found.best == "at first contact"
    assert [m.numbers for m in found.models] == [2, 2]
    (pair,) = found.pairs
    assert pair.held_out.clear
    assert pair.held_out.blocks == 10
    assert found.models[0].test == pytest.approx(first.metrics["test"].nrmse_percent)  # type: ignore[union-attr]
    # What a folder keeps of its candidates gives the same pair.
    both = replace(first, candidates=(first, replace(later, name="from 8 N")))
    save(both, tmp_path / "both")
    kept = compare_candidates(tmp_path / "both")
    again = kept.pair("LinearSponge", "from 8 N").held_out
    assert again == pytest.approx(pair.held_out)
    assert [m.bic for m in kept.models] == pytest.approx([m.bic for m in found.models])
    assert "figures alone" in kept.notes[0]
    with pytest.raises(InputError, match="one model was tried"):
        compare_candidates(tmp_path / "from 8 N")


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


def test_sums_over_other_inputs_are_not_compared() -> None:
    u = 2 - 2 * np.cos(np.arange(121) / 5)
    small, large = (
        identify.fit(Record.from_arrays(k * u, k * u + np.sin(np.arange(121)) / 50), "Preisach")
        for k in (1.0, 1.5)
    )
    refuses("not-comparable", lambda: change(small, large), "3.99", "5.99")


def test_what_cannot_be_compared_is_refused() -> None:
    before, after = line(*pressed(*NEW, seed=0)), line(*pressed(*AGED, seed=1))
    fixed = line(*pressed(*AGED, seed=1), slope=1.2)
    assert change(before, fixed).left_out == {"K": "fixed", "threshold": "fixed"}
    K, *others = after.parameters
    in_metres = replace(after, parameters=(K._replace(unit="m / N"), *others))
    assert change(before, in_metres).left_out["K"] == "in m / N and mm / N"
    refuses("given-twice", lambda: change(before, before), "same rows")
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


def by_quadrature(z: np.ndarray, V: np.ndarray, prior: np.ndarray) -> tuple[np.ndarray, ...]:
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
    wanted = np.einsum("k,ksi->si", weight, centre)
    np.testing.assert_allclose(found.specimens.mean((0, 1)), wanted, atol=0.01)


def test_specimens_are_drawn_to_the_mean_as_far_as_their_data_leave_open() -> None:
    values = [(1.1, 5.0), (1.2, 5.5), (1.25, 5.3), (1.3, 6.0)]
    fits = [line(*pressed(*v, seed=k, noise=3.0)) for k, v in enumerate(values)]
    found = pool(fits)
    K, b = found.parameters
    assert (K.name, K.unit, b.unit) == ("K", "mm / N", "mm")
    assert found.left_out == {"threshold": "fixed"}
    assert (found.new.shape, found.specimens.shape) == ((4000, 2), (4000, 4, 2))
    assert found.words[0].startswith("K: mean 1.2")
    assert found.words[-1] == "Not pooled: threshold (fixed)."
    assert K.new.low < K.mean.low < K.mean.value < K.mean.high < K.new.high
    # The other way round the draws are others; 4,000 of them, and the interval's ends its tails.
    other_b, other_K = pool(fits[::-1], ["b", "K"]).parameters
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


def test_what_the_first_cycle_alone_tells_has_the_errors_of_the_fit() -> None:
    """The three numbers of a steady loop do not tell the four of a solid: how it runs in does. Two records
    of one specimen then differ by the noise of their first cycles."""
    t = np.arange(0, 120, 0.25)
    force = 8 - 8 * np.cos(2 * np.pi * t / 12)
    true = np.asarray(StandardLinearSolid(2.0, 1.5, 4.0, 0.3).simulate(t, force))
    fits = []
    for seed in (102, 103):
        noisy = true + 0.05 * np.random.default_rng(seed).normal(size=len(t))
        one = fit(
            Record.from_arrays(force, noisy, time=t), "StandardLinearSolid", noise="gaussian",
            conditioning="keep", clocks="keep", starts=2,
        )  # fmt: skip
        # The model is right and the noise white, so its own errors hold. Of nine cycles, 0.45 to 1.59 holds
        # 98 % of the ratios of one parameter.
        ratio = repeatability(one).stderr / np.sqrt(np.diagonal(one.covariance))
        assert ((ratio > 0.4) & (ratio < 1.8)).all()
        fits.append(one)
    found = identify.change(*fits)
    assert found.p > 0.01
    assert not any(p.clear for p in found.parameters)
    assert found.words[0].startswith("No significant change: p = ")


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
    softer = 0.05 * fits[0].parameters[0].value
    assert aged.parameters[0].difference == pytest.approx(softer, rel=0.1)


def test_parameters_carry_both_errors(fits: list[FitResult], tmp_path: Path):
    """Through save and load."""
    found = identify.load(identify.save(fits[0], tmp_path / "fit"))
    told = repeatability(fits[0])
    assert [p.repeatability for p in found.parameters if p.status == "free"] == told.stderr.tolist()
    assert "from cycle to cycle" in found.summary()
    assert fitted(3, cycles=2).parameters[0].repeatability is None
