"""What is made of a module's numbers, once."""

import weakref
from collections.abc import Callable
from typing import Any, TypeVar

import jax
from jax.core import Tracer

from .laws import FORGET

Made = TypeVar("Made")


def once(make: Callable[[Any], Made]) -> Made:
    """A property that is made at the first use, of a module whose fields never change. While JAX traces the
    numbers, it is made at every use."""
    # Beside the modules: JAX takes one with something in it for a module of another structure.
    known: dict[int, Made] = {}
    FORGET.append(known.clear)

    def get(module: Any) -> Made:
        made = known.get(id(module))
        if made is None:
            made = make(module)
            if not any(isinstance(x, Tracer) for x in jax.tree.leaves(made)):
                known[id(module)] = made
                weakref.finalize(module, known.pop, id(module), None)
        return made

    return property(get, doc=make.__doc__)  # type: ignore[return-value]
