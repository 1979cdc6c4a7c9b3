"""Where a Preisach model's relays are given: its output, and its output in saturation."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from ._preisach import Preisach


def whole_output(
    model: Preisach, relays: Float[Array, "*samples"], u: Float[Array, "*samples"]
) -> Float[Array, "*samples"]:
    """offset + R(u) +- relays, by element."""
    return model._output(relays, *model._place(u))


def saturated_outputs(model: Preisach) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """The output where the last relay has switched: all down at `low`, and all up at `high`.

    **Example:**

        >>> low, high = hysteresis.preisach.saturated_outputs(preisach)
        >>> float(low), float(high)
        (-21.0, 21.0)
    """
    mass = model.density.mass(model.density.tabulate())
    low, high = (jnp.full_like(mass, u) for u in (model.density.low, model.density.high))
    return whole_output(model, -mass, low), whole_output(model, mass, high)
