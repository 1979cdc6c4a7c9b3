"""Every density against its definition, and the laws that Everett's function of any density keeps."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hysteresis.internal import SumDensity
from hysteresis.preisach import GaussianDensity, GridDensity, LorentzianDensity
from tests.densities import DENSITIES, plain_everett
from tests.problems import HIGH, LOW, histories
from tests.refusals import raises, refuses
from tests.thorough import rest_thorough

every = pytest.mark.parametrize(
    "name", rest_thorough(DENSITIES, lambda name: name in ("warped", "GaussianDensity", "sum"))
)
seeds = st.integers(0, 2**32 - 1)
EPS = np.finfo(float).eps
INPUTS = 7
"""One number, so that every density compiles once: they are asked for all pairs of as many inputs."""


@eqx.filter_jit
def everett(density: Any, a: jax.Array, b: jax.Array) -> jax.Array:
    return density.everett(density.tabulate(), density.pair(a, b))


@eqx.filter_jit
def mass(density: Any) -> jax.Array:
    return density.mass(density.tabulate())


def make(name: str, seed: int) -> Any:
    return DENSITIES[name](np.random.default_rng(seed), LOW, HIGH)


def all_pairs(density: Any, u: np.ndarray) -> np.ndarray:
    a, b = np.meshgrid(u, u, indexing="ij")
    got = everett(density, jnp.asarray(a.ravel()), jnp.asarray(b.ravel()))
    return np.asarray(got).reshape(len(u), len(u))


@every
@settings(max_examples=15)
@given(seed=seeds, u=histories(LOW, HIGH, INPUTS))
def test_laws_of_the_everett_function(name: str, seed: int, u: np.ndarray):
    """Zero on the diagonal, symmetric, rising in a and falling in b, no rectangle of negative mass."""
    density = make(name, seed)
    E, total = all_pairs(density, np.sort(u)), float(mass(density))
    # Sums of up to a hundred parts of the mass, each rounded.
    rounding = 100 * EPS * total
    assert np.abs(np.diagonal(E)).max() <= rounding
    np.testing.assert_allclose(E, E.T, rtol=0, atol=rounding)
    lower = np.tril(np.ones_like(E, bool))
    assert np.diff(E, axis=0)[lower[:-1]].min() >= -rounding
    assert np.diff(E, axis=1)[lower[:, 1:]].max() <= rounding
    rectangles = -np.diff(np.diff(E, axis=0), axis=1)
    assert rectangles[np.tril_indices(INPUTS - 1, -1)].min() >= -rounding
    ends = all_pairs(density, np.linspace(LOW, HIGH, INPUTS))
    assert abs(ends[-1, 0] - total) <= rounding
    assert abs(float(getattr(density, "total", total)) - total) <= rounding


@pytest.mark.parametrize("name", DENSITIES)
def test_equal_to_the_definition(name: str):
    """Quadratures differ by 1e-13 of the mass, and leave 1e-11 where the density is narrowest."""
    for seed in range(3):
        density, rng = make(name, seed), np.random.default_rng(seed)
        u = rng.uniform(LOW, HIGH, INPUTS)
        wanted = [[plain_everett(density, a, b) for b in u] for a in u]
        np.testing.assert_allclose(all_pairs(density, u), wanted, rtol=0, atol=1e-10)


@pytest.mark.parametrize("name", rest_thorough(DENSITIES, lambda name: name == "sum"))
def test_gradients_against_central_differences(name: str):
    """In every parameter and both inputs, along random directions.

    A step h = eps^(1/3) leaves 4e-11 of truncation and rounding, times third derivatives; 1e-6 leaves
    four decades for those.
    """
    rng, h = np.random.default_rng(5), EPS ** (1 / 3)
    inputs = jnp.asarray(rng.uniform(LOW, HIGH, (2, INPUTS**2)))
    c = jnp.asarray(rng.normal(size=INPUTS**2))
    arrays, rest = eqx.partition((make(name, 5), *inputs), eqx.is_inexact_array)
    flat, structure = jax.tree.flatten(arrays)

    def value(flat: list[Any]) -> jax.Array:
        return c @ everett(*eqx.combine(jax.tree.unflatten(structure, flat), rest))

    slopes = jax.jit(jax.grad(value))(flat)
    for k, slope in enumerate(slopes):
        direction = rng.normal(size=flat[k].shape)
        up, down = (
            float(value([x + by * direction if j == k else x for j, x in enumerate(flat)]))
            for by in (h, -h)
        )
        along = float((np.asarray(slope) * direction).sum())
        assert abs(along - (up - down) / (2 * h)) <= 1e-6 * (1 + abs(along)), k


UNIFORM_NODES = (0.0, 0.1, 0.15, 0.6, 0.7, 1.0)
WIDTHS = np.diff(UNIFORM_NODES)
AREAS = np.outer(WIDTHS, WIDTHS) * (1 - np.eye(5) / 2)
UNIFORM: dict[str, Any] = {"warped": GridDensity(0.0, 1.0, AREAS, nodes=UNIFORM_NODES)}
UNIFORM["sum"] = SumDensity(2 * [UNIFORM["warped"]])


@every
@settings(max_examples=20)
@given(seed=seeds, u=histories(LOW, HIGH, INPUTS))
def test_where_an_input_lies_is_the_same_on_the_host_and_back(name: str, seed: int, u: np.ndarray):
    density = make(name, seed)
    on_host, traced = density.pair(u, u[::-1]), density.pair(jnp.asarray(u), jnp.asarray(u[::-1]))
    for one, other in zip(*map(jax.tree.leaves, (on_host, traced)), strict=True):
        np.testing.assert_array_equal(one, other)
    if isinstance(density, GridDensity):
        # An input and the node beside it, each rounded.
        back = density.at(*density.locate(u))
        np.testing.assert_allclose(back, u, rtol=0, atol=8 * EPS * (HIGH - LOW))


def test_densities_that_are_refused():
    w = np.ones((2, 2))
    with raises("length-mismatch", "2 nodes for 2 cells"):
        GridDensity(0.0, 1.0, w, nodes=(0.0, 1.0))
    refuses("out-of-range", lambda: GridDensity(0.0, 1.0, w, nodes=(0.0, 0.5, 2.0)), "from 0 to 2")
    refuses("not-increasing", lambda: GridDensity(0.0, 1.0, w, nodes=(0.0, 0.0, 1.0)))
    with raises("parameter-out-of-bounds", "bias_width is 0"):
        GaussianDensity(0.0, 1.0, 1.0, 0.1, 0.1, 0.5, 0.0)
    with raises("parameter-out-of-bounds", "order"):
        LorentzianDensity(0.0, 1.0, 1.0, 0.1, 0.1, 0.5, 0.1, order=0)
    refuses("zero-range", lambda: LorentzianDensity(1.0, 1.0, 1.0, 0.1, 0.1, 0.5, 0.1))
    refuses("bad-parts", lambda: SumDensity(()))
