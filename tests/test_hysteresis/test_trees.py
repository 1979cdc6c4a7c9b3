"""Every model's tree of laws: run forwards it is the model, and JAX traces and differentiates it."""

from collections.abc import Iterator
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from hysteresis import (
    AbstractModel,
    BoucWen,
    Burgers,
    Conditioned,
    DuhemForce,
    InputError,
    LinearSponge,
    MonotoneCurve,
    Oscillator,
    Preisach,
    Scaled,
    Series,
    Softening,
    Sum,
)
from hysteresis.curves import Clip, MonotoneSpline, PolynomialCurve
from hysteresis.laws._tree import node_of
from hysteresis.preisach import GaussianDensity, GridDensity
from hysteresis.trees import Tree, plain
from tests import compositions
from tests.problems import (
    PROBLEMS,
    Problem,
    clock,
    kinds_often,
    random_histories,
    variants_thorough,
    weights,
)

LOW, HIGH, ROWS = -1.0, 2.0, 60


def _conditioned(scale: float, axis: str):
    def make(rng: np.random.Generator) -> Conditioned:
        curves = [MonotoneCurve.even(LOW - k, HIGH + k, rng.uniform(0.1, 1.0, 4)) for k in range(3)]
        models = [Series([one, Burgers(*rng.uniform(1, 40, 4))]) for one in curves]
        turned = [Scaled(one, scale * rng.uniform(0.5, 2)) if scale else one for one in models]
        return Conditioned(turned, np.array([1.0, 2.0, 5.0]), axis=axis)

    return make


def _demagnetised(rng: np.random.Generator) -> Preisach:
    return Preisach(GridDensity(LOW, HIGH, weights(rng)), initial="demagnetised", capacity=16)


def _curves(rng: np.random.Generator) -> Series:
    spline = MonotoneSpline.even(0.0, HIGH, rng.uniform(0.1, 1, 4), rng.normal())
    return Series([Clip(0.0), spline, PolynomialCurve(rng.uniform(0.1, 1, 4))])


def _duhem_oscillator(rng: np.random.Generator) -> Oscillator:
    rising, falling = rng.uniform(0.2, 1, (2, 5))
    return Oscillator(400.0, 5.0, 1.5, DuhemForce(rising, falling, 2.0), 3)


def _without_range(rng: np.random.Generator) -> Sum:
    """Parts that do not say for which inputs they were made."""
    return Sum([BoucWen(rng.uniform(0.5, 2), 0.3, 0.4, 1.5), LinearSponge(rng.uniform(0.5, 2))])


MORE = {
    "conditioned": _conditioned(0.0, "linear"), "conditioned-log": _conditioned(1.0, "logarithmic"),
    "conditioned-falling": _conditioned(-1.0, "reciprocal"), "demagnetised": _demagnetised,
    "curves": _curves, "without-range": _without_range,
    "recovering": lambda rng: Softening(LOW, HIGH, rng.uniform(0.1, 0.5, (3, 3)), 3.0, leading=False),
    "maxwell-leading": compositions.nonlinear_maxwell,
    "duhem-oscillator": _duhem_oscillator,
}  # fmt: skip
OTHERS = [
    Problem(name, make, LOW, HIGH, frozenset(), compositions.held) for name, make in MORE.items()
]
TREES = [*PROBLEMS, *OTHERS]
every = pytest.mark.parametrize("problem", variants_thorough(TREES), ids=lambda p: p.name)


def numbers(tree: Tree) -> Iterator[Any]:
    """All floating numbers of a tree that have a derivative, those of its parts last: the `size` of a sum's
    output, which says what rounding is, has none."""
    for values in (tree.get("parameters", {}), tree.get("state", {})):
        for name, value in values.items():
            if name != "size" and jnp.issubdtype(jnp.asarray(value).dtype, jnp.floating):
                yield jnp.ravel(jnp.asarray(value))
    for part in tree.get("parts", ()):
        yield from numbers(part)


def flat(model: AbstractModel) -> jax.Array:
    return jnp.concatenate(list(numbers(model.tree())))


def whole(tree: Tree) -> Any:
    """What no parameter may change: kinds, names, lengths and the integers among the parameters."""
    p = tree.get("parameters", {})
    sizes = {name: x if isinstance(x, int) else np.shape(x) for name, x in p.items()}
    assert all(isinstance(x, int) or jnp.asarray(x).dtype.kind == "f" for x in p.values())
    states = [(name, np.shape(x)) for name, x in tree.get("state", {}).items()]
    return tree["kind"], sizes, states, [whole(part) for part in tree.get("parts", ())]


@every
def test_run_forwards_it_is_the_model(problem: Problem):
    """To 1e-9 of the range. An oscillator goes from force to displacement by its `find`."""
    model = problem.model()
    u = random_histories(np.random.default_rng(0), problem.low, problem.high, (1, ROWS))[0]
    t = clock(1, ROWS)
    c = np.random.default_rng(2).uniform(0.5, 6.0, ROWS)
    conditioned = isinstance(model, Conditioned)
    y = np.asarray(model.simulate(t, np.column_stack([u, c]) if conditioned else u))
    takes: list[Any] = []
    it = node_of(plain(model.tree()), takes=takes)
    go = it.find if isinstance(model, Oscillator) else it.move
    found = []
    for dt, x, condition in zip(np.diff(t, prepend=t[0]).tolist(), u, c, strict=True):
        for take in takes:
            take(float(condition))
        found.append(go(dt, float(x)))
    assert np.abs(np.array(found) - y).max() <= 1e-9 * np.ptp(y)


@pytest.mark.parametrize("problem", kinds_often(TREES), ids=lambda p: p.name)
def test_it_is_traced_and_differentiated(problem: Problem):
    """Along a direction through all parameters, as by central differences; of many models at once, too."""
    model, other = problem.model(0), problem.model(1)
    values, rest = eqx.partition(model, eqx.is_inexact_array)
    random, step = np.random.default_rng(3), 1e-6

    def moved(x: Any) -> Any:
        # An exponent of 1 stays: of a force it decides whether there is a law.
        still = ~jnp.isfinite(x) | (x == 1.0)
        return jnp.asarray(random.normal(size=x.shape)) * jnp.where(still, 0.0, jnp.abs(x))

    def of(values: Any) -> jax.Array:
        made = eqx.combine(values, rest)
        assert whole(made.tree()) == whole(model.tree())
        return flat(made)

    way = jax.tree.map(moved, values)
    found = jax.jit(lambda way: jax.jvp(of, (values,), (way,)))(way)
    here = np.asarray(flat(model))
    np.testing.assert_allclose(
        found[0], here, rtol=1e-12, atol=1e-12 * np.abs(here[np.abs(here) < 1e20]).max()
    )
    ends = [
        np.asarray(of(jax.tree.map(lambda x, w, s=s: x + s * w, values, way)))
        for s in (step, -step)
    ]
    slopes = (ends[0] - ends[1]) / (2 * step)
    size = np.maximum(np.abs(here), np.abs(slopes).max())
    assert (np.abs(found[1] - slopes) <= 1e-6 * size).all()
    both = jax.tree.map(lambda *x: jnp.stack(x), values, eqx.filter(other, eqx.is_inexact_array))
    many = jax.jit(jax.vmap(of))(both)
    np.testing.assert_allclose(many[1], flat(other), rtol=1e-9, atol=1e-12)


@every
def test_what_depends_on_no_parameter_is_a_constant(problem: Problem):
    """What JAX makes is free, what NumPy makes has no derivative: so nothing that is traced may be constant
    in the tree of known parameters."""
    model = problem.model()
    traced: list[Tree] = []
    values, rest = eqx.partition(model, eqx.is_inexact_array)
    jax.eval_shape(lambda v: traced.append(eqx.combine(v, rest).tree()) or 0.0, values)

    def pairs(a: Tree, b: Tree) -> Iterator[tuple[str, Any, Any]]:
        for part in ("parameters", "state"):
            for name, x in a.get(part, {}).items():
                yield f"{a['kind']}.{name}", x, b[part][name]
        for one, two in zip(a.get("parts", ()), b.get("parts", ()), strict=True):
            yield from pairs(one, two)

    for name, x, y in pairs(traced[0], model.tree()):
        assert not isinstance(x, jax.core.Tracer) or isinstance(y, jax.Array), name


def test_a_density_without_a_grid_has_no_tree():
    density = GaussianDensity(0.0, 1.0, 1.0, 0.1, 0.1, 0.5, 0.1)
    with pytest.raises(InputError, match="GaussianDensity") as refused:
        Preisach(density).tree()
    assert refused.value.code == "not-exportable"
