"""What every compensator's `step` keeps, whatever is wrong with the readings."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from compensate import Status
from tests.problems import without


def check_stream(compensator: Any, t: np.ndarray, y: np.ndarray, off: float = 1e-9) -> None:
    """`simulate` is the scan of `step`, from any row on; bad samples are said and leave no trace."""
    hole = ~np.isfinite(y).reshape(len(t), -1).all(1)
    whole = jax.tree.map(np.asarray, compensator.simulate(t, y))
    step, state = jax.jit(lambda *now: compensator.step(*now)), compensator.init()
    states = [state]
    for k, (now, reading) in enumerate(zip(t, jnp.asarray(y), strict=True)):
        state, found = step(state, now, reading)
        for one, every in zip(*map(jax.tree.leaves, (found, whole)), strict=True):
            np.testing.assert_allclose(one, every[..., k], rtol=0, atol=off)
        if hole[k]:
            assert found.status == Status.INVALID
            jax.tree.map(np.testing.assert_array_equal, states[-1], state)
        states.append(state)
    half = len(t) // 2
    rest = compensator.simulate(t[half:], y[half:], states[half])
    np.testing.assert_allclose(rest.value, whole.value[half:], rtol=0, atol=off)
    np.testing.assert_array_equal(whole.status == Status.INVALID, hole)
    if hole.any():
        # The good samples are those of a record that never had the others.
        alone = np.asarray(compensator.simulate(*without(hole, t, y)).value)[: (~hole).sum()]
        np.testing.assert_allclose(alone, whole.value[~hole], rtol=0, atol=off)
