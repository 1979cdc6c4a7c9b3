"""The laws that every model keeps, as a function to call in the tests of a model of your own."""

from collections.abc import Iterator
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree

from . import _serialisation as files
from ._errors import InputError
from ._model import AbstractModel
from ._parameter import parameter_at as _parameter_at
from ._parameter import parameters
from .models._conditioned import Conditioned
from .models._conditioned import condition_of as _condition_of

SAMPLES, HISTORIES = 40, 4


class _Walk(NamedTuple):
    """Times, or None where the model does without, and inputs."""

    t: np.ndarray | None
    u: np.ndarray


def check_model(model: AbstractModel, low: float, high: float) -> None:
    """Assert that a model keeps the laws of `AbstractModel`. It needs neither pytest nor Hypothesis.

    For histories between `low` and `high`, with turning points, plateaus and uneven times, it checks that

    - `simulate` gives the outputs of `step`, one sample after the other, and they are finite;
    - a record split in two gives the same outputs when the state is carried over;
    - every sequence of `starts` begins in the virgin state;
    - `jit` and `vmap` give what the plain call gives;
    - derivatives in every parameter and in the input agree with finite differences. One history of
      four may differ, because a difference across a corner of the model is not its derivative;
    - a file of the model gives the same model back, so that its class has to be registered;
    - a model that works without times gives the same with any.

    **Arguments:**

    - `model`: with parameters inside their bounds.
    - `low`, `high`: the inputs of the histories. The condition of a model that takes one goes beyond its
      knots on either side.

    Raises `AssertionError` that says which law failed, where, and by how much.

    **Example:**

        >>> from hysteresis import LinearSponge
        >>> from hysteresis.testing import check_model
        >>> check_model(LinearSponge(K=2.0, b=1.0), low=0.0, high=10.0)
    """
    walks = list(_walks(model, low, high))
    for walk in walks:
        _check_step(model, walk)
        _check_split(model, walk)
        _check_transformations(model, walk)
    _check_sequences(model, walks)
    _check_gradients(model, walks)
    _check_file(model, walks[0])
    _check_times(model, walks[0])


def _walks(model: AbstractModel, low: float, high: float) -> Iterator[_Walk]:
    random = np.random.default_rng(0)
    conditioned = _condition_of(model)
    needs_times = _needs_times(model, _with_condition(conditioned, np.linspace(low, high, SAMPLES)))
    for turns in np.linspace(3, SAMPLES, HISTORIES).astype(int):
        corners = random.uniform(low, high, turns)
        u = np.interp(np.linspace(0, turns - 1, SAMPLES), np.arange(turns), corners)
        u[SAMPLES // 2] = u[SAMPLES // 2 - 1]  # a plateau
        t = np.cumsum(10.0 ** random.uniform(-2, 1, SAMPLES))
        yield _Walk(t if needs_times else None, _with_condition(conditioned, u, random))


def _with_condition(
    model: Conditioned | None, u: np.ndarray, random: np.random.Generator | None = None
) -> np.ndarray:
    """Inputs as a model takes them: beside a condition that changes, where it takes one."""
    if model is None:
        return u
    first, last = float(model.knots[0]), float(model.knots[-1])
    part = (random or np.random.default_rng(0)).uniform(-0.2, 1.2, len(u))
    low = first / 2 if model.axis != "linear" else -np.inf
    return np.column_stack([u, np.maximum(first + part * ((last - first) or 1.0), low)])


def _needs_times(model: AbstractModel, u: np.ndarray) -> bool:
    try:
        model.simulate(None, u)
    except InputError:
        return True
    return False


def _check_step(model: AbstractModel, walk: _Walk) -> None:
    y = np.asarray(model.simulate(*walk))
    assert y.shape == walk.u.shape[:1], (
        f"simulate gives the shape {y.shape} for inputs {walk.u.shape}"
    )
    assert np.isfinite(y).all(), (
        f"simulate: the output is not finite at sample {np.argmin(np.isfinite(y))}"
    )
    _equal("simulate == the scan of step", y, model.stream(*walk)[1], model)


def _check_split(model: AbstractModel, walk: _Walk) -> None:
    k = SAMPLES // 3
    first, rest = (
        _Walk(None if walk.t is None else walk.t[part], walk.u[part])
        for part in (slice(k), slice(k, None))
    )
    whole, state = model.simulate(*walk), model.stream(*first)[0]
    _equal("a split record carries the state", model.simulate(*rest, state), whole[k:], model, k)


def _check_sequences(model: AbstractModel, walks: list[_Walk]) -> None:
    u = np.concatenate([walk.u for walk in walks])
    t = None if walks[0].t is None else np.concatenate([np.asarray(walk.t) for walk in walks])
    alone = np.concatenate([model.simulate(*walk) for walk in walks])
    starts = tuple(range(0, len(u), SAMPLES))
    _equal("sequences begin in the virgin state", model.simulate(t, u, starts=starts), alone, model)


def _check_transformations(model: AbstractModel, walk: _Walk) -> None:
    t, u = (None if x is None else jnp.asarray(x, float) for x in walk)
    plain = model.simulate(t, u)
    _equal("jit of prepare and evaluate", _whole(model, t, u), plain, model)
    arrays, static = eqx.partition(model, eqx.is_array)
    several = jax.tree.map(lambda x: jnp.stack([x, x]), arrays)
    if jax.tree.leaves(several):
        for y in _side_by_side(several, static, model.prepare(t, u)):
            _equal("vmap over parameters", y, plain, model)


# Compiled once for all histories.
@eqx.filter_jit
def _whole(model: AbstractModel, t: Any, u: Any) -> Any:
    return model.evaluate(model.prepare(t, u))


@eqx.filter_jit
def _side_by_side(several: Any, static: Any, prepared: Any) -> Any:
    return eqx.filter_vmap(lambda arrays: eqx.combine(arrays, static).evaluate(prepared))(several)


def _check_gradients(model: AbstractModel, walks: list[_Walk]) -> None:
    """One compiled function for all histories: the sum of weighted outputs, by parameters and input."""
    weights = jnp.asarray(np.random.default_rng(1).normal(size=SAMPLES))
    free = {
        name: jnp.asarray(value)
        for name, info, value in parameters(model)
        if value is not None and not info.fixed and np.isfinite(np.asarray(value)).all()
    }

    def summed(values: Any, t: Any, u: Any) -> Any:
        changed = model
        for name, value in values.items():
            changed = eqx.tree_at(lambda m, n=name: _parameter_at(m, n), changed, value)
        return jnp.sum(weights * changed.evaluate(changed.prepare(t, u)))

    # By inputs forwards, which is all that a model offers whose law runs outside JAX.
    by_parameters, by_inputs = jax.jit(jax.grad(summed)), jax.jit(jax.jacfwd(summed, 2))
    value = jax.jit(summed)
    bad: dict[str, list[str]] = {}
    for number, walk in enumerate(walks):
        t, u = None if walk.t is None else jnp.asarray(walk.t, float), jnp.asarray(walk.u, float)
        # Off the plateaus: where the input stands still, a model may have a corner.
        shaken = np.random.default_rng(100 + number).uniform(-1, 1, walk.u.shape)
        u = u + jnp.asarray(1e-3 * np.ptp(walk.u) * shaken, u.dtype)
        by_values, by_input = by_parameters(free, t, u), by_inputs(free, t, u)
        for name, vector in (*free.items(), ("input", u)):
            flat, back = ravel_pytree(vector)
            wanted = ravel_pytree(by_input if name == "input" else by_values[name])[0]
            size = jnp.abs(flat).max()
            step = jnp.finfo(flat.dtype).eps ** (1 / 3) * jnp.where(size > 0, size, 1.0)
            way = np.random.default_rng(number).normal(size=flat.shape)
            ends = []
            for sign in (-1, 1):
                moved = back(flat + sign * step * way)
                at = (free, t, moved) if name == "input" else (free | {name: moved}, t, u)
                ends.append(float(value(*at)))
            difference = (ends[1] - ends[0]) / (2 * float(step))
            derivative = float(wanted @ way)
            scale = float(jnp.abs(wanted) @ np.abs(way)) + max(map(abs, ends))
            off = abs(derivative - difference)
            if not off <= 300 * float(jnp.finfo(flat.dtype).eps) ** (2 / 3) * scale:
                said = f"history {number}: derivative {derivative:.8g}, difference {difference:.8g}"
                bad.setdefault(name, []).append(said)
    for name, said in bad.items():
        assert len(said) < 2, (
            f"the gradient in {name} == finite differences fails. {'; '.join(said)}"
        )


def _check_file(model: AbstractModel, walk: _Walk) -> None:
    try:
        again = files.rebuilt(*files.described(model))
    except InputError as error:
        raise AssertionError(f"a file gives the model back: {error}") from error
    assert type(again) is type(model), (
        f"a file of a {type(model).__name__} gives {type(again)} back"
    )
    _equal("a file gives the model back", again.simulate(*walk), model.simulate(*walk), model)


def _check_times(model: AbstractModel, walk: _Walk) -> None:
    if walk.t is None:
        t = np.cumsum(np.random.default_rng(2).uniform(0.1, 3.0, SAMPLES))
        law = "without times the output is that of any times"
        _equal(law, model.simulate(t, walk.u), model.simulate(*walk), model)


def _equal(law: str, got: Any, wanted: Any, model: AbstractModel, first: int = 0) -> None:
    """Equal to rounding: so many additions of numbers of the size of output and parameters."""
    got, wanted = np.asarray(got), np.asarray(wanted)
    assert got.shape == wanted.shape, f"{law}: the shapes are {got.shape} and {wanted.shape}"
    sizes = [np.asarray(value) for _, _, value in parameters(model) if value is not None]
    scale = np.abs(wanted).max() + sum(np.abs(size[np.isfinite(size)]).sum() for size in sizes)
    tolerance = 64 * SAMPLES * np.finfo(wanted.dtype).eps * scale
    off = np.abs(got - wanted)
    if not (off <= tolerance).all():
        at = int(np.argmax(np.where(np.isfinite(off), off, np.inf)))
        raise AssertionError(
            f"{law} fails at sample {first + at}: {got[at]:.8g} and {wanted[at]:.8g} are {off[at]:.3g}"
            f" apart, and rounding explains {tolerance:.1g}."
        )
