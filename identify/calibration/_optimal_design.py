"""Optimal experimental design: pick the measurements that most reduce the variance of the goals."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from hysteresis import InputError

from ._calibrate import prior_of

System = TypeVar("System", bound=eqx.Module)


class Choice(NamedTuple):
    """Candidate measurements in the order in which they were chosen.

    - `chosen`: indices of the candidates; one that appears twice is a measurement to repeat.
    - `expected`: root mean square standard deviation of the goals after none, one, two, ... of them.
    """

    chosen: Int[np.ndarray, " count"]
    expected: Float[np.ndarray, " count_1"]


def choose(
    system: System,
    residuals: Callable[[System], Array],
    goals: Callable[[System], Array],
    deviations: Mapping[str, Any],
    count: int,
) -> Choice:
    """Choose `count` of many possible measurements for a calibration, one after the other (A-optimal).

    Each step takes the candidate c that leaves the least total variance of the goals,

        trace(G S G'),      S = (1 + sum over the chosen of J_c'J_c)^-1,

    with J_c the Jacobian of its residuals and G that of the goals, in the unconstrained space of
    `calibrate`. Nothing needs to have been measured: J and G are taken at `system`, which must be near
    enough to the truth.

    **Arguments:**

    - `system`: a Module with the values expected before the measurements.
    - `residuals`: function of a system; returns (candidates, ...), divided by the noise's standard
      deviation, as for `calibrate`.
    - `goals`: function of a system; returns an array of any shape, the quantities to be known.
    - `deviations`: prior standard deviations by name, as for `calibrate`.
    - `count`: how many measurements to choose.

    Raises `InputError` `bad-option` if `count` is less than one, and as `calibrate` for the deviations.

    Source: Atkinson, Donev, Tobias, Optimum Experimental Designs, with SAS (2007), chapter 10.

    In the example: which force tells most about the stiffness of a line?
    """
    if count < 1:
        raise InputError(
            "bad-option", f"{count} measurements cannot be chosen.", fix="ask for one or more."
        )
    prior = prior_of(system, deviations)
    start = jnp.zeros(len(prior.names))

    @eqx.filter_jit
    def jacobians(prior: Any) -> tuple[Array, Array]:
        of_rows = jax.jacfwd(lambda z: residuals(prior.at(z)))(start)
        rows = of_rows.reshape(len(of_rows), -1, len(start))
        wanted = jax.jacfwd(lambda z: jnp.ravel(goals(prior.at(z))))(start)
        return jnp.einsum("crj,crk->cjk", rows, rows), wanted

    information, G = map(np.asarray, jacobians(prior))
    values, vectors = np.linalg.eigh(information)
    roots = np.sqrt(np.maximum(values, 0))[..., None] * np.swapaxes(vectors, 1, 2)
    S, chosen = np.eye(len(start)), []
    expected = [np.sum((G @ S) * G)]
    for _ in range(count):
        B = roots @ S
        gains = np.linalg.solve(B @ np.swapaxes(roots, 1, 2) + np.eye(len(start)), B)
        lost = np.einsum("cjk,cjl,gk,gl->c", B, gains, G, G, optimize=True)
        best = int(np.argmax(lost))
        S = S - B[best].T @ gains[best]
        chosen.append(best)
        expected.append(np.sum((G @ S) * G))
    return Choice(np.array(chosen), np.sqrt(np.maximum(expected, 0) / len(G)))
