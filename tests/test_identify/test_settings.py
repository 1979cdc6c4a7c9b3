"""What is said of parameters: bounds, priors, fixed and tied ones, and what cannot be meant."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.stats

from hysteresis import AbstractModel, Burgers, GeneralizedMaxwell, LinearSponge, Record
from identify import fit, load, save
from identify.parameters._transform import transform
from tests.refusals import refuses

BURGERS = Burgers(2.0, 100.0, 1.0, 8.0, 0.3)


def record(noise: float = 0.02, model: AbstractModel = BURGERS, seed: int = 0) -> Record:
    """Half a minute of steps and ramps."""
    t = np.linspace(0.0, 30.0, 120)
    u = np.interp(t, np.linspace(0, 30, 9), [0, 5, 5, 1, 1, 4, 4, 0, 0])
    y = np.asarray(model.simulate(t, u))
    return Record.from_arrays(u, y + np.random.default_rng(seed).normal(0, noise, len(t)), t)


def test_priors_are_scipys() -> None:
    said = {
        "E1": ("normal(2, 3)", scipy.stats.norm(2, 3)),
        "eta1": ("log-normal(100, 2)", scipy.stats.lognorm(np.log(2), scale=100)),
        "E2": ("half-normal(3)", scipy.stats.halfnorm(scale=3)),
        "offset": ("uniform(-1, 4)", scipy.stats.uniform(-1, 5)),
    }
    priors = {name: {"prior": prior} for name, (prior, _) in said.items()}
    found = fit(record(), BURGERS, parameters=priors, noise="gaussian", starts=1)
    for name, (prior, scipys) in said.items():
        made = found.settings[name].prior
        assert str(made) == prior
        x = scipys.ppf(np.linspace(0.1, 0.9, 9))
        densities = [float(made.log_density(jnp.asarray(value))) for value in x]
        np.testing.assert_allclose(densities, scipys.logpdf(x), rtol=1e-10)
        drawn = made.draws(np.random.default_rng(0), 4000)
        assert scipy.stats.kstest(drawn, scipys.cdf).pvalue > 1e-3


@pytest.mark.parametrize(
    "said",
    ["normal", "normal(1)", "normal(1, 0)", "log-normal(0, 2)", "log-normal(1, 0.5)", "cauchy(0, 1)",
     "uniform(2, 1)", "half-normal(-1)", "normal(a, b)", "normal(1, inf)"],
)  # fmt: skip
def test_no_prior(said: str) -> None:
    refuses("bad-prior", lambda: fit(record(), BURGERS, parameters={"E1": {"prior": said}}), "E1")


@pytest.mark.parametrize("said", [
    {"K": {"prior": "log-normal(2, 1.5)"}},
    {"K": {"bounds": [0.5, 3], "prior": "uniform(0.5, 3)"}},
    {"K": {"prior": "half-normal(2)"}}, {"K": {"bounds": [0.5, 3]}},
    {"b": {"prior": "normal(0.2, 0.1)"}}, {},
])  # fmt: skip
def test_a_prior_is_a_density_of_the_free_number(said: dict[str, Any]) -> None:
    """Its integral over z is 1, whichever bounds the parameter has."""
    other = "b" if "K" in said or not said else "K"
    known = said | {other: {"fixed": True}}
    line = LinearSponge(1.0, 0.2, 1.5)
    found = fit(record(), line, parameters=known, noise="gaussian", starts=1)
    bounds = transform(found.model, 5.0, settings=found.settings)
    z = np.linspace(-60.0, 60.0, 200_001)[:, None]
    density = np.exp(np.asarray(jax.vmap(bounds.log_prior)(jnp.asarray(z))))
    # The trapezoids are 0.02 of the narrowest prior wide.
    assert np.trapezoid(density, z[:, 0]) == pytest.approx(1.0, abs=1e-3)


def test_tied_and_fixed_parameters_stay_so() -> None:
    said = {"eta2": {"tied": "8 * E2"}, "offset": {"fixed": 0.3}, "E1": {"bounds": [1, 4]}}
    result = fit(record(), BURGERS, parameters=said, starts=4, noise="gaussian")
    model: Any = result.model
    assert float(model.eta2) == pytest.approx(8 * float(model.E2), rel=1e-12)
    assert float(model.offset) == 0.3
    found = {p.name: p for p in result.parameters}
    source, tied = found["E2"], found["eta2"]
    assert tied.status == "tied"
    assert tied.stderr == pytest.approx(8 * source.stderr, rel=1e-12)  # type: ignore[operator]
    assert (tied.low, tied.high) == pytest.approx((8 * source.low, 8 * source.high), rel=1e-12)  # type: ignore[operator]
    assert found["offset"].status == "fixed"
    assert found["E1"].stderr is not None
    assert found["E1"].low < found["E1"].value < found["E1"].high  # type: ignore[operator]
    assert result.covariance.shape == (3, 3)


def test_a_prior_pulls_as_its_weight_says(tmp_path: Any) -> None:
    """Of a line the posterior of the offset is known: a mean weighted with the two precisions."""
    u = np.linspace(0.0, 10.0, 200)
    y = 2 * u + 1 + np.random.default_rng(1).normal(0, 0.5, 200)
    line = LinearSponge(1.0, 0.0, -np.inf)
    free = fit(Record.from_arrays(u, y), line, starts=4, noise="gaussian")
    said = {"b": {"prior": "normal(0, 0.1)"}}
    pulled = fit(Record.from_arrays(u, y), line, starts=4, noise="gaussian", parameters=said)
    # The noise is estimated anew about the shifted line.
    told = np.linalg.inv(free.covariance) * (free.noise.sigma / pulled.noise.sigma) ** 2
    precision = told + np.diag([0.0, 1 / 0.1**2])
    at = np.array([p.value for p in free.parameters if p.status == "free"])
    expected = np.linalg.solve(precision, told @ at)
    found = np.array([p.value for p in pulled.parameters if p.status == "free"])
    # Errors are 0.3 % wider than the information alone would have them.
    np.testing.assert_allclose(found, expected, rtol=3e-3)
    save(pulled, tmp_path / "fit")
    again = load(tmp_path / "fit")
    assert again.settings == pulled.settings
    assert float(again.noise_model.sigma) == pytest.approx(pulled.noise.sigma)


@pytest.mark.parametrize(("said", "code", "words"), [
    ({"e1": {"fixed": 1}}, "unknown-parameter", "did you mean E1?"),
    ({"E1": {"begin": 1}}, "unknown-key", "begin"), ({"E1": {"bounds": 3}}, "bad-bounds", "3"),
    ({"E1": {"bounds": [3, 1]}}, "bad-bounds", "[3, 1]"),
    ({"E1": {"bounds": [2.0, 5]}}, "start-out-of-bounds", "gradient vanishes"),
    ({"E1": {"start": -1}}, "start-out-of-bounds", "outside of"),
    ({"E1": {"prior": "uniform(3, 4)"}}, "start-out-of-bounds", "start inside"),
    *(
        (said, "bad-tie", "E1") for said in (
            {"E1": {"tied": "E9"}}, {"E1": {"tied": "E1"}}, {"E1": {"tied": "E2 + 1"}},
            {"E1": {"tied": "E2", "start": 2}}, {"E1": {"tied": "E2"}, "E2": {"tied": "eta1"}},
        )
    ),
])  # fmt: skip
def test_what_cannot_be_meant(said: dict[str, Any], code: str, words: str) -> None:
    refuses(code, lambda: fit(record(), BURGERS, parameters=said), words)


def test_nothing_free_and_no_model() -> None:
    said = {name: {"fixed": True} for name in ("K", "b")}
    line = LinearSponge(1.0, 0.0, 1.5)
    refuses("nothing-free", lambda: fit(record(), line, parameters=said), "every parameter")
    refuses("unknown-parameter", lambda: fit(record(), "auto", parameters=said))
    refuses("bad-option", lambda: fit(record(), "Burgers", noise="pink"))


def test_one_entry_of_an_array_is_fixed_and_the_others_move(tmp_path: Any) -> None:
    """On its bound, tied or fixed inside: a branch of strength 0 is not there, and its fit loads."""
    chain = GeneralizedMaxwell(1.0, [2.0, 1.0], [1.0, 10.0])
    for said, gone in (
        ({"E.1": {"fixed": 0.0}}, {"E.1"}),
        ({"E.1": {"fixed": 0.5}}, {"E.1"}),
        ({"E.1": {"tied": "2 * E.0"}}, {"E.1"}),
        ({"tau.0": {"fixed": 3.0}, "E.1": {"fixed": 0.0}}, {"tau.0", "E.1"}),
    ):
        found = fit(record(), chain, parameters=said, noise="gaussian", starts=1)
        bounds = transform(found.model, 1.0, settings=found.settings)
        assert {"E_inf", "E.0", "E.1", "tau.0", "tau.1", "offset"} - set(bounds.names) == gone
        # Other starts join where what is free here moves there too.
        assert len(bounds.points_of(found.model, chain)) == 2
    data = record(0.01, GeneralizedMaxwell(3.0, [4.0], [6.0]), seed=1)
    found = fit(data, "GeneralizedMaxwell", parameters={"E.1": {"fixed": 0}})
    told = {p.name: p for p in found.parameters}
    assert (told["E.1"].status, told["E.0"].status) == ("fixed", "free")
    for name, value in (("E.0", 4.0), ("tau.0", 6.0), ("E_inf", 3.0)):
        assert abs(told[name].value - value) < 4 * told[name].stderr < 0.1 * value
    save(found, tmp_path / "fit")
    assert load(tmp_path / "fit").model.E.tolist() == [told["E.0"].value, 0.0]
