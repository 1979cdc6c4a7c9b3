"""What is made of a module's numbers, once."""

from collections.abc import Callable
from typing import Any, TypeVar

import jax

from ._parameter import is_concrete

Made = TypeVar("Made")


def once(make: Callable[[Any], Made]) -> Made:
    """A property that is made at the first use, of a module whose fields never change. While JAX traces the
    numbers, it is made at every use."""
    name = f"once {make.__qualname__}"

    def get(module: Any) -> Made:
        made = vars(module).get(name)
        if made is None:
            made = make(module)
            if all(map(is_concrete, jax.tree.leaves(made))):
                vars(module)[name] = made
        return made

    return property(get, doc=make.__doc__)  # type: ignore[return-value]
