"""Double precision in what a fit and its results compute, whatever precision JAX is set to.

JAX starts in single precision, in which solvers stop early and errors come out wrong. What a user's own
code computes stays in the precision that it has: it is switched for the time of a call, in its thread.
"""

import inspect
from collections.abc import Callable, Iterable
from functools import wraps
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from ._errors import InputError

F = TypeVar("F", bound=Callable[..., Any])
_WIDER = {"float32": "float64", "complex64": "complex128", "int32": "int64"}


def is_double() -> bool:
    """Whether JAX computes in double precision in this thread."""
    return bool(jax.config.jax_enable_x64)  # type: ignore[attr-defined]


def in_double(function: F) -> F:
    """A function that computes in double precision, also with models that were made in single precision;
    its `inner` is the one that other processes find by its name.

    With `allow_float32=True`, or of a fit made so, it keeps JAX's precision, as it does while JAX traces
    its caller.
    """

    @wraps(function)
    def call(*args: Any, **options: Any) -> Any:
        kept = options.get("allow_float32") or any(
            _has(x.model, "float32") for x in args if hasattr(x, "model")
        )
        if is_double() or kept or _is_traced(args):
            return function(*args, **options)
        with jax.enable_x64(True):
            args, named = jax.tree.map(_wider, (args, tuple(options.values())), is_leaf=_is_leaf)
            return function(*args, **dict(zip(options, named, strict=True)))

    call.inner = function  # type: ignore[attr-defined]
    return call  # type: ignore[return-value]


def in_own_precision(function: F) -> F:
    """A function that computes in double precision where one of its arguments, such as a model, is.

    Raises `InputError` `single-precision` where JAX traces the call in single precision.
    """

    @wraps(function)
    def call(*args: Any, **options: Any) -> Any:
        if is_double() or not any(_has(getattr(x, "model", x), "float64") for x in args):
            return function(*args, **options)
        if _is_traced(args):
            raise InputError(
                "single-precision",
                "This model is in double precision, and your JAX program runs in single precision.",
                fix="hysid.enable_x64()",
            )
        with jax.enable_x64(True):
            return function(*args, **options)

    return call  # type: ignore[return-value]


class PickledAsItIs:
    """A module that pickles and copies keep in its precision: JAX unpickles arrays in its own."""

    def __getstate__(self) -> dict[str, Any]:
        return dict(vars(jax.tree.map(_boxed, self)))

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        with jax.enable_x64(True):
            vars(self).update(vars(jax.tree.map(_unboxed, self)))


class _Box:
    """The numbers of an array of JAX."""

    def __init__(self, numbers: Any):
        self.numbers = numbers


def _boxed(x: Any) -> Any:
    return _Box(np.asarray(x)) if isinstance(x, jax.Array) and not isinstance(x, Tracer) else x


def _unboxed(x: Any) -> Any:
    return jnp.asarray(x.numbers) if isinstance(x, _Box) else x


def keep_precision(cls: type, names: Iterable[str]) -> None:
    """Let the methods that a class defines compute `in_own_precision`."""
    for name in names:
        if (method := cls.__dict__.get(name)) is not None:
            setattr(cls, name, in_own_precision(_unbound(method)))


def in_this_precision(function: F) -> F:
    """A function that a thread calls in the precision of the one that made it."""
    double = is_double()

    @wraps(function)
    def call(*args: Any) -> Any:
        with jax.enable_x64(double):
            return function(*args)

    return call  # type: ignore[return-value]


def _unbound(method: Any) -> Callable[..., Any]:
    """A method as a function of the instance, also one that `eqx.filter_jit` has made an object of."""

    @wraps(method)
    def call(self: Any, *args: Any, **options: Any) -> Any:
        return method.__get__(self, type(self))(*args, **options)

    return method if inspect.isfunction(method) else call


def _is_leaf(x: Any) -> bool:
    return not isinstance(x, (list, tuple, eqx.Module))


def _is_traced(args: tuple[Any, ...]) -> bool:
    # While JAX compiles, new arrays are traced too; under `jax.grad` only what depends on the arguments is.
    return any(isinstance(x, Tracer) for x in (*jax.tree.leaves(args), jnp.zeros(())))


def _wider(x: Any) -> Any:
    wider = _WIDER.get(str(x.dtype)) if isinstance(x, jax.Array) else None
    return x if wider is None else jnp.asarray(x, wider)


def _has(tree: Any, dtype: str) -> bool:
    return any(isinstance(x, jax.Array) and x.dtype == dtype for x in jax.tree.leaves(tree))
