"""Which measurements to take: those after which what is wanted is known best."""

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
    """Candidates in the order in which they were chosen, and what is then known.

    - `chosen`: numbers of the candidates; one may come more than once, a measurement that is repeated.
    - `expected`: root mean square deviation of the goals after none, one, two, ... of them.
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
    """Choose `count` of many possible measurements, one after the other, for a calibration.

    Each time the one that leaves the least variance of the goals, the trace of G S G', with S = (1 +
    sum of J_c'J_c)^-1 the covariance in the free space of `calibrate` after all that were chosen: A-optimal
    for what is wanted, not for the numbers themselves. No measurement need have been made: J and G are
    taken at `system`, which has to be near enough to the truth.

    **Arguments:**

    - `residuals`: of a system, (candidates, ...), over their noise, as `calibrate` takes them.
    - `goals`: of a system, an array of any shape: what is to be known.
    - `deviations`: as of `calibrate`.

    Raises `InputError` where `count` is less than one, and as `calibrate` for the deviations.
    """
    if count < 1:
        raise InputError("bad-option", f"{count} measurements to choose.", fix="one or more.")
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
