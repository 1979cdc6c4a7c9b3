"""Posteriors: against analytic ones, reproducible, resumable, and honest about convergence."""

from dataclasses import replace
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from hysteresis import Record
from identify import fit, load_posterior, sample, save, save_posterior
from identify.internal import target
from tests.refusals import raises, refuses
from tests.test_identify.test_posterior.test_checkpoint import interrupting


def line(noise: float = 0.1, n: int = 200) -> Record:
    u = np.abs((np.arange(n) / 25 + 1) % 2 - 1)
    y = 2 * u + 1 + np.random.default_rng(0).normal(0, noise, n)
    return Record.from_arrays(u, y)


def asked_of(**parameters):
    """The settings of a fit that was told these."""
    return fit(line(), "LinearSponge", parameters=parameters, starts=1, noise="gaussian").settings


@pytest.fixture(scope="module")
def line_fit():
    return fit(line(), "LinearSponge", seed=0, conditioning="keep")


@pytest.fixture(scope="module")
def line_posterior(line_fit):
    return sample(line_fit, seed=1)


def test_emcee_on_a_line_is_the_analytic_posterior(line_fit, line_posterior) -> None:
    """Flat priors, unknown sigma: a Student-t about the least-squares line."""
    posterior = line_posterior
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


def test_without_steps_it_goes_on_until_it_can_be_believed(line_fit, tmp_path) -> None:
    told = []
    posterior = sample(line_fit, seed=5, progress=lambda *said: told.append(said))
    assert posterior.converged
    assert (posterior.notes, posterior.long_enough) == ((), True)
    assert "R-hat 1.0" in told[-1][2]
    assert told[-1][0] == told[-1][1]
    assert all(s.contraction is not None and 0.9 < s.contraction <= 1 for s in posterior.summaries)
    assert all(s.modes == 1 for s in posterior.summaries)
    short = sample(line_fit, most=30, seed=5)
    assert not short.converged
    assert "not converged after 30 steps" in short.notes[0]


@pytest.fixture(scope="module")
def kept(line_fit, tmp_path_factory) -> Path:
    file = tmp_path_factory.mktemp("chains") / "chains.npz"
    sample(line_fit, steps=20, checkpoint=file)
    return file


@pytest.mark.parametrize(("what", "changed", "options"), [
    ("data", lambda fit: replace(fit, train=replace(fit.train, output=fit.train.output + 1e-9)), {}),
    ("model", lambda fit: replace(fit, model=replace(fit.model, K=fit.model.K + 1e-9)), {}),
    ("noise", lambda fit: replace(fit, noise_model=replace(fit.noise_model, tail=jnp.asarray(0.1))), {}),
    ("priors", lambda fit: replace(fit, settings=asked_of(K={"prior": "normal(2, 1)"})), {}),
    ("seed", lambda fit: fit, {"seed": 1}),
    ("ensembles", lambda fit: fit, {"ensembles": 3}),
    ("walkers", lambda fit: fit, {"walkers": 18}),
], ids=lambda value: value if isinstance(value, str) else "")  # fmt: skip
def test_chains_are_only_gone_on_from_where_all_is_the_same(line_fit, kept, what, changed, options):
    with raises("other-checkpoint", f"another {what}"):
        sample(changed(line_fit), steps=30, checkpoint=kept, resume=True, **options)


@pytest.mark.parametrize(("options", "code"), [
    ({"steps": 3}, "bad-option"), ({"most": 10}, "bad-option"),
    ({"ensembles": 1}, "bad-option"), ({"walkers": 4}, "bad-option"),
    ({"walkers": 17}, "bad-option"), ({"seed": -1}, "bad-option"),
])  # fmt: skip
def test_bad_settings_are_refused(line_fit, options, code) -> None:
    refuses(code, lambda: sample(line_fit, **options))


def test_what_was_drawn_before_ctrl_c_is_the_result(line_fit, tmp_path) -> None:
    """As the chains of a whole run begin; before 20 steps nothing is."""

    def interrupted(at: int):
        kept, stop = tmp_path / "chains.npz", interrupting(at)
        return sample(line_fit, 60, seed=3, checkpoint=kept, every=1e9, progress=stop)

    ended = interrupted(20)
    assert any("interrupted after" in note for note in ended.notes)
    assert np.isfinite(ended.draws).all()
    whole = sample(line_fit, 60, seed=3, checkpoint=tmp_path / "chains.npz", resume=True)
    np.testing.assert_array_equal(whole.draws, sample(line_fit, 60, seed=3).draws)


def test_nothing_free_is_nothing_to_sample(line_fit) -> None:
    fixed = asked_of(K={"fixed": True}) | asked_of(b={"fixed": True})
    refuses("nothing-free", lambda: sample(replace(line_fit, settings=fixed)))


def test_draws_of_every_row_are_those_of_the_target(line_fit, line_posterior) -> None:
    posterior = line_posterior
    rows, aim = posterior.per_row, target(line_fit)
    np.testing.assert_array_equal(rows.observed, line_fit.train.output[rows.rows])
    ensembles, _, count = rows.log_likelihood.shape
    assert count == len(line_fit.train)
    # The first draw of each ensemble is the first that was kept.
    first = np.asarray(posterior.draws[:, 0])
    free = aim.bounds.from_values(first[:, :2]), aim.noise_bounds.from_values(first[:, 2:])
    point = np.column_stack(free)
    for k in range(ensembles):
        wanted = aim.pointwise(jnp.asarray(point[k]))
        np.testing.assert_allclose(rows.log_likelihood[k, 0], wanted, rtol=1e-9, atol=1e-9)
    # Every row's 90 % range holds nine readings of ten: 200 rows, three deviations of 2 per cent.
    low, high = np.quantile(rows.predictive, [0.05, 0.95], axis=(0, 1))
    inside = ((rows.observed > low) & (rows.observed < high)).mean()
    assert inside == pytest.approx(0.9, abs=0.065)


def test_arviz_reads_the_groups(line_fit, line_posterior, tmp_path) -> None:
    import arviz  # for two seconds

    posterior = line_posterior
    save(line_fit, tmp_path)
    save_posterior(posterior, tmp_path)
    again = load_posterior(tmp_path)
    assert again.summaries == posterior.summaries
    assert (again.notes, again.converged) == (posterior.notes, True)
    data = arviz.from_netcdf(tmp_path / "posterior.nc")
    # Before ArviZ 1 a method, since then the paths of a tree.
    groups = data.groups() if callable(data.groups) else data.groups
    assert {name.strip("/") for name in groups} - {""} == {
        "posterior", "sample_stats", "prior", "log_likelihood", "posterior_predictive", "observed_data",
    }  # fmt: skip
    assert data.posterior["K"].dims == ("chain", "draw")
    assert data.log_likelihood["output"].dims == ("chain", "draw", "row")
    np.testing.assert_array_equal(data.sample_stats["lp"], posterior.log_probability)
    np.testing.assert_array_equal(data.observed_data["output"], line_fit.train.output)
    assert data.posterior_predictive["output"].shape == data.log_likelihood["output"].shape
    data.close()
