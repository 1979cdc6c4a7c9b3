"""Posteriors: against analytic ones, reproducible, resumable, and honest about convergence."""

import jax
import numpy as np
import pytest

from compensate import invert
from hysteresis import InputError, Preisach, Record
from hysteresis.rigs import SpongeRig
from identify import fit, load_posterior, sample, save, save_posterior
from identify._posterior import rhat


def line(noise: float = 0.1, n: int = 200) -> Record:
    u = np.abs((np.arange(n) / 25 + 1) % 2 - 1)
    y = 2 * u + 1 + np.random.default_rng(0).normal(0, noise, n)
    return Record.from_arrays(u, y)


@pytest.fixture(scope="module")
def line_fit():
    return fit(line(), "LinearSponge", seed=0, conditioning="keep")


def test_emcee_on_a_line_is_the_analytic_posterior(line_fit) -> None:
    """Flat priors, unknown sigma: a Student-t about the least-squares line."""
    posterior = sample(line_fit, steps=2000, seed=1)
    assert posterior.converged
    u, y = line_fit.train.input, line_fit.train.output
    A = np.stack([u, np.ones_like(u)], 1)
    exact = np.linalg.inv(A.T @ A) * line_fit.noise.sigma**2 * line_fit.noise.correlation_time
    centre = np.linalg.solve(A.T @ A, A.T @ y)
    for k in range(2):
        found, sd = posterior.summaries[k], np.sqrt(exact[k, k])
        # Monte Carlo: sd / sqrt(ess) of the mean, 1 / sqrt(2 ess) of the sd, taken four times over;
        # the Student-t is a hundredth wider than the Gaussian.
        assert found.mean == pytest.approx(centre[k], abs=4 * sd / np.sqrt(found.ess))
        assert found.sd == pytest.approx(sd, rel=4 / np.sqrt(2 * found.ess) + 0.02)
    assert posterior.summaries[2].mean == pytest.approx(0.1, rel=0.15)  # 1/sqrt(2 N) = 5 %


def test_a_seed_makes_a_posterior_repeatable(line_fit) -> None:
    one, other, third = (sample(line_fit, steps=60, seed=s) for s in (3, 3, 4))
    np.testing.assert_array_equal(one.draws, other.draws)
    assert not np.array_equal(one.draws, third.draws)


def test_resumed_chains_are_the_uninterrupted_ones(line_fit, tmp_path) -> None:
    whole = sample(line_fit, steps=120, seed=2, checkpoint=tmp_path / "whole.h5")
    sample(line_fit, steps=50, seed=2, checkpoint=tmp_path / "parts.h5")
    resumed = sample(line_fit, steps=120, seed=2, checkpoint=tmp_path / "parts.h5", resume=True)
    np.testing.assert_array_equal(resumed.draws, whole.draws)


def test_a_checkpoint_of_another_model_is_refused(line_fit, tmp_path) -> None:
    sample(line_fit, steps=30, checkpoint=tmp_path / "chains.h5")
    t = np.arange(200) * 0.1
    other = fit(Record.from_arrays(line().input, line().output, t), "Burgers", starts=4)
    with pytest.raises(InputError) as error:
        sample(other, steps=60, checkpoint=tmp_path / "chains.h5", resume=True)
    assert error.value.code == "other-checkpoint"


def test_too_few_steps_are_refused(line_fit) -> None:
    with pytest.raises(InputError):
        sample(line_fit, steps=3)


@pytest.fixture(scope="module")
def grid_fit():
    cycles = SpongeRig().five_cycles(noise=0.05, seed=0)
    record = Record.from_arrays(cycles.force, cycles.displacement, cycles.time, input_unit="N")
    return fit(record, "Preisach", test_cycles=1, seed=0)


def test_projected_draws_have_no_negative_weight_and_an_inverse(grid_fit) -> None:
    posterior = sample(grid_fit, steps=40, seed=0)
    model = posterior.model
    assert isinstance(model, Preisach)
    assert float(model.density.weights.min()) >= 0  # type: ignore[attr-defined]
    u, y = grid_fit.train.input, grid_fit.train.output
    with pytest.raises(InputError, match="vmap"):
        invert(model)
    estimates = jax.vmap(lambda m: invert(m).simulate(None, y).value)(model)
    assert estimates.shape == (160, len(u))
    # Every draw is an exact inverse of itself, so the spread is the posterior's, not the solver's.
    again = jax.vmap(lambda m, v: m.simulate(None, v))(model, estimates)
    reachable = np.abs(np.asarray(again) - y).max(0) < 1e-9 * np.ptp(y)
    assert reachable.mean() > 0.5


def test_predictive_band_covers_the_held_out_cycle(grid_fit) -> None:
    """90 % of the fifth cycle, which no fit has seen, within the 90 % band: 20 readings."""
    posterior = sample(grid_fit, steps=100, seed=0)
    record = grid_fit.test
    curves = np.asarray(jax.vmap(lambda m: m.simulate(None, record.input))(posterior.model))
    random = np.random.default_rng(0)
    curves = curves + random.normal(size=curves.shape) * posterior.draws[..., -1].reshape(-1, 1)
    low, high = np.quantile(curves, [0.05, 0.95], axis=0)
    inside = (record.output >= low) & (record.output <= high)
    # Binomial(20, 0.9): below 14 in 1 of 90; the cycles settle, so a little off is no surprise.
    assert inside[record.mask].sum() >= 13


def test_posterior_comes_back_and_other_tools_read_it(grid_fit, tmp_path) -> None:
    import h5netcdf

    save(grid_fit, tmp_path)
    assert load_posterior(tmp_path) is None
    posterior = sample(grid_fit, steps=20, seed=0)
    save_posterior(posterior, tmp_path)
    again = load_posterior(tmp_path)
    assert again is not None
    np.testing.assert_array_equal(again.draws, posterior.draws)
    for one, other in zip(
        jax.tree.leaves(again.model), jax.tree.leaves(posterior.model), strict=True
    ):
        np.testing.assert_array_equal(one, other)
    with h5netcdf.File(tmp_path / "posterior.nc") as file:
        assert file["posterior"]["offset"].dimensions == ("chain", "draw")
    (tmp_path / "posterior.nc").write_bytes(b"cut off")
    with pytest.raises(InputError, match="sample again"):
        load_posterior(tmp_path)


def test_rhat_tells_ensembles_that_disagree() -> None:
    random = np.random.default_rng(0)
    same = random.normal(size=(4, 2000))
    # sd of R-hat for independent draws is about 1 / draws.
    assert rhat(same) < 1.005
    assert rhat(same + np.arange(4)[:, None] * 0.5) > 1.05
    assert rhat(same * (1 + np.arange(4)[:, None])) > 1.05  # only the folded ranks see this
