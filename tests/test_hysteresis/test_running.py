"""Trees of laws over time: what is compiled is the plain text, and its derivatives are exact."""

import subprocess
import sys
from collections.abc import Iterator, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hysteresis import (
    AbstractModel,
    LinearSponge,
    PrandtlIshlinskii,
    Scaled,
    Series,
    StandardLinearSolid,
    Sum,
)
from hysteresis.laws._tree import node_of
from hysteresis.running import Numbers, _compiled, estimates, numbers_of, outputs
from hysteresis.running import _over_time as over_time
from hysteresis.trees import plain
from tests.problems import INVERTIBLE, PROBLEMS, SAMPLES, VARIANTS, Problem, clock, random_histories
from tests.thorough import rest_thorough

FORWARDS = [problem for problem in PROBLEMS if problem.name != "oscillator"]

COMPILED = ("sum", "bouc-wen", "series")
"""Of every run: compiling all takes minutes."""


def some_compiled(problems: Sequence[Problem]) -> Any:
    return pytest.mark.parametrize("problem", rest_thorough(problems, lambda p: p.name in COMPILED))


def numbers(model: AbstractModel) -> Numbers:
    return numbers_of(model.tree())


def history(problem: Problem, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Inputs and times since the sample before."""
    rng = np.random.default_rng(seed)
    u = random_histories(rng, problem.low, problem.high, (1, SAMPLES))[0]
    return u, np.diff(clock(seed), prepend=clock(seed)[0])


@pytest.fixture
def compiled() -> Iterator[None]:
    """Whatever is short, too."""
    pytest.importorskip("numba")
    with over_time.compiled_at_once():
        yield


@pytest.fixture
def without_numba(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in (over_time, _compiled):
        monkeypatch.setattr(module, "available", lambda: False)
    monkeypatch.setattr(over_time, "loop_of", _compiled.loop_of.__wrapped__)


@some_compiled(FORWARDS)
@pytest.mark.usefixtures("compiled")
def test_compiled_outputs_are_those_of_the_text(problem: Problem):
    """Bit for bit: no operation changes its order."""
    model = problem.model()
    u, dt = history(problem)
    node = node_of(plain(model.tree()))
    wanted = [node.move(*now) for now in zip(dt.tolist(), u.tolist(), strict=True)]
    np.testing.assert_array_equal(over_time.run(numbers(model), u, dt).value, wanted)


@some_compiled(INVERTIBLE)
@pytest.mark.usefixtures("compiled")
def test_compiled_estimates_are_those_of_the_text(problem: Problem):
    model = problem.model()
    u, dt = history(problem)
    y = np.asarray(model.simulate(np.cumsum(dt), u))
    node = node_of(plain(model.tree()))
    wanted = [(node.find(*now), node.status()) for now in zip(dt.tolist(), y.tolist(), strict=True)]
    found = over_time.find(numbers(model), y, dt)
    np.testing.assert_array_equal(np.stack([found.value, found.status], 1), wanted)


LEAVES: list[AbstractModel] = [
    LinearSponge(2.0, 1.0),
    PrandtlIshlinskii(np.array([0.1, 0.5]), np.array([0.3, 0.2]), 0.5),
    StandardLinearSolid(1.0, 2.0, 5.0),
]

SHAPES = st.recursive(
    st.integers(0, len(LEAVES) - 1), lambda parts: st.lists(parts, min_size=1, max_size=3), max_leaves=6
)  # fmt: skip


def nested(shape: Any, deep: int = 0) -> AbstractModel:
    """Sums of chains of sums ...; one alone is scaled."""
    if isinstance(shape, int):
        return LEAVES[shape]
    parts = [nested(part, deep + 1) for part in shape]
    return Scaled(parts[0], -2.0) if len(parts) == 1 else (Series, Sum)[deep % 2](parts)


@given(SHAPES)
@settings(max_examples=20)
def test_nodes_within_nodes_are_put_together_alike(shape: Any):
    """Of addresses as in plain Python."""
    model = nested(shape)
    tree, dt = plain(model.tree()), np.full(12, 0.1)
    u = random_histories(np.random.default_rng(1), 0.0, 1.0, (1, 12))[0]
    own = numbers(model)
    for way, run in (("move", over_time.run), ("find", over_time.find)):
        node = node_of(tree)
        wanted = [getattr(node, way)(*now) for now in zip(dt.tolist(), u.tolist(), strict=True)]
        np.testing.assert_array_equal(run(own, u, dt).value, wanted)
        if way == "find":
            assert over_time.find(own, u, dt).status[-1] == node.status()


def _freed(tree: dict[str, Any]) -> dict[str, Any]:
    """With all real parameters made by JAX, so that all have derivatives."""
    found = dict(tree)
    if "parameters" in tree:
        found["parameters"] = {
            name: value if isinstance(value, int) else jnp.asarray(value, float)
            for name, value in tree["parameters"].items()
        }
    return found | ({"parts": [_freed(one) for one in tree["parts"]]} if "parts" in tree else {})


@pytest.mark.parametrize(("problem", "way"), rest_thorough(
    [(p, way) for p in FORWARDS for way in ("compiled", "without_numba")],
    lambda pair: pair[0].name not in VARIANTS and (pair[1] == "compiled") == (pair[0].name in COMPILED),
))  # fmt: skip
def test_columns_are_the_derivatives(problem: Problem, way: str, request: pytest.FixtureRequest):
    """Against central differences: by four combinations of all numbers, and by the input."""
    request.getfixturevalue(way)
    own = numbers_of(_freed(plain(problem.model().tree())))
    u, dt = history(problem)
    rng = np.random.default_rng(1)
    size, reals = len(own.m), len(own.m) - own.known.states
    free = [k for k in own.known.free if k < reals and own.m[k] not in (0.0, 1e30, -1e30)]
    dm, du = np.zeros((size, 5)), np.zeros((SAMPLES, 5))
    dm[free, :4] = rng.uniform(-1, 1, (len(free), 4)) * np.abs(own.m[free])[:, None]
    du[:, 4] = rng.normal(size=SAMPLES)
    found = over_time.tangents(own, dm, u, dt, du)
    step = 1e-7
    for k in range(5):
        ends = [
            over_time.run(own._replace(m=own.m + s * dm[:, k]), u + s * du[:, k], dt).value
            for s in (step, -step)
        ]
        wanted = (ends[0] - ends[1]) / (2 * step)
        off = np.abs(found.columns[:, k] - wanted)
        # Rounding of the outputs over the step; a kink may lie between the ends.
        assert np.quantile(off, 0.9) <= 1e-6 * (1.0 + np.abs(wanted).max()), k
    # Numbers that are directions of their own are marked in another way.
    alone = over_time.tangents(own, np.eye(size)[:, free], u, dt).columns @ dm[free, :4]
    np.testing.assert_allclose(alone, found.columns[:, :4], rtol=1e-9, atol=1e-9 * np.ptp(alone))
    # A root is one step of Newton's nearer.
    again = over_time.run(own, u, dt).value
    np.testing.assert_allclose(found.value, again, rtol=0, atol=1e-14 * np.abs(again).max())


def _plays(theta: Any) -> PrandtlIshlinskii:
    return PrandtlIshlinskii(theta[:2], theta[2:4], theta[4])


THETA = np.array([0.1, 0.4, 0.3, 0.2, 1.0])


@pytest.mark.parametrize("seed", rest_thorough([0, 1], 1))
def test_inside_programs_of_jax_it_is_the_same(seed: int):
    rng = np.random.default_rng(seed)
    u, none, theta = rng.normal(size=20), np.zeros(20), jnp.asarray(THETA)

    def run(theta: Any) -> Any:
        return outputs(numbers(_plays(theta)), u, none)[0]

    def back(theta: Any) -> Any:
        return estimates(numbers(_plays(theta)), run(theta), none, 0.0).value

    plain_run = run(theta)
    np.testing.assert_array_equal(jax.jit(run)(theta), plain_run)
    lanes = jax.vmap(run)(jnp.stack([theta, 1.1 * theta]))
    np.testing.assert_array_equal(lanes[0], plain_run)
    forward, reverse = jax.jacfwd(run)(theta), jax.jacrev(run)(theta)
    np.testing.assert_allclose(forward, reverse, rtol=0, atol=1e-14)
    # What is found behind the outputs is the input, whatever the parameters.
    np.testing.assert_allclose(back(theta), u, rtol=0, atol=1e-12)
    np.testing.assert_allclose(jax.jacfwd(back)(theta), 0.0, rtol=0, atol=1e-12)
    np.testing.assert_allclose(
        jax.jvp(lambda u: outputs(numbers(_plays(theta)), u, none)[0], (u,), (u,))[1],
        _along(u, theta), rtol=0, atol=1e-6,
    )  # fmt: skip


def _along(u: np.ndarray, theta: Any) -> np.ndarray:
    ends = [outputs(numbers(_plays(theta)), (1 + s) * u, 0 * u)[0] for s in (1e-7, -1e-7)]
    return (np.asarray(ends[0]) - np.asarray(ends[1])) / 2e-7


READING = """
import sys
from concurrent.futures import ThreadPoolExecutor
from hysteresis.running._law import law

def read(kind):
    for _ in range(20):
        law.cache_clear()
        law(kind)

kinds = ["plays", "oscillator", "bouc_wen", "preisach", "maxwell", "chain", "stops", "guard"]
sys.setswitchinterval(1e-6)
with ThreadPoolExecutor(8) as pool:
    list(pool.map(read, kinds))
"""


@pytest.mark.thorough
def test_several_threads_may_read_laws():
    """Two threads of the search for plays did so first, and failed now and then."""
    subprocess.run([sys.executable, "-c", READING], check=True)
