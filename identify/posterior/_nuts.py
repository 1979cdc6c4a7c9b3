"""The No-U-Turn sampler by blackjax, for posteriors of many parameters."""

import time
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from hysteresis import InputError

from ._chains import Chains, Progress
from ._convergence import bulk_ess, rhat
from ._log_posterior import Target
from ._mode import Top, top_of

WARM_UP = 500
BLOCK = 100


def sample_nuts(
    aim: Target, steps: int, chains: int, seed: int, tell: Progress, notes: tuple[str, ...] = ()
) -> Chains:
    """Independent chains side by side, each adapted by itself for 500 steps before those that are kept.

    They walk in coordinates in which Laplace's covariance is the unit matrix; the window adaptation finds
    the step size, and what is left of the scales. Chains start two of its deviations from the fit.

    Raises `InputError` where blackjax is not installed.

    Source: Hoffman, Gelman, The No-U-Turn Sampler, JMLR 15 (2014); Phan and others, arXiv:1912.11554.
    """
    try:
        import blackjax
    except ImportError as error:
        raise InputError(
            "missing-extra",
            'method="nuts" needs blackjax, which is not installed.',
            fix="pip install 'hysid[nuts]', or sample with emcee.",
        ) from error
    # blackjax mixes types and ranks as JAX does by default, whatever the application has set.
    with jax.numpy_dtype_promotion("standard"), jax.numpy_rank_promotion("allow"):
        top = top_of(aim)
        w, density, acceptance, divergent, length = _walked(
            blackjax, aim, top, steps, chains, seed, tell
        )
    points = np.asarray(top.point) + w @ np.asarray(top.root).T
    columns = np.moveaxis(points, -1, 0)
    ess = np.array([bulk_ess(column) for column in columns])
    if divergent.any():
        notes += (
            f"{int(divergent.sum())} of {divergent.size} trajectories diverged: the posterior bends more"
            " sharply somewhere than the steps can follow, and draws there may be missing.",
        )
    return Chains(
        points=points[:, :, None],
        log_probability=density[:, :, None],
        rhat=np.array([rhat(column) for column in columns]),
        ess=ess,
        thin=1,
        autocorrelation=float(divergent.size / ess.min()),
        long_enough=True,
        acceptance=float(acceptance.mean()),
        statistics={"acceptance_rate": acceptance, "diverging": divergent, "n_steps": length},
        method=f"NUTS, {chains} chains, {steps:,} steps",
        notes=notes,
    )


def _walked(
    blackjax: Any, aim: Target, top: Top, steps: int, chains: int, seed: int, tell: Progress
) -> tuple[np.ndarray, ...]:
    """(places in Laplace's coordinates, log-probability, acceptance, divergent, leapfrog steps), each
    (chains, steps, ...)."""
    begin = time.perf_counter()
    parameters = len(aim.names)

    def density(w: Array) -> Array:
        return aim.log_probability(top.point + top.root @ w)

    tell(0, steps, f"{WARM_UP} steps of adaptation")
    adaptation: Any = blackjax.window_adaptation(blackjax.nuts, density)
    first_key, warm_key, key = jax.random.split(jax.random.key(seed), 3)
    first = _first(density, 2 * jax.random.normal(first_key, (chains, parameters)), parameters)
    warm = jax.jit(jax.vmap(lambda k, w: adaptation.run(k, w, WARM_UP)[0]))
    state, found = warm(jax.random.split(warm_key, chains), first)
    kernel = blackjax.nuts.build_kernel()

    def step(state: Any, key: Array) -> tuple[Any, Any]:
        state, info = jax.vmap(lambda k, s, f: kernel(k, s, density, **f))(
            jax.random.split(key, chains), state, found
        )
        rest = (info.acceptance_rate, info.is_divergent, info.num_integration_steps)
        return state, (state.position, state.logdensity, *rest)

    run = jax.jit(lambda state, keys: jax.lax.scan(step, state, keys))
    blocks, done = [], 0
    while done < steps:
        state, block = run(state, jax.random.split(jax.random.fold_in(key, done), BLOCK))
        blocks.append(jax.tree.map(np.asarray, block))
        done += BLOCK
        acceptance, divergent = (float(np.mean([b[k] for b in blocks])) for k in (2, 3))
        to_go = (time.perf_counter() - begin) / done * max(steps - done, 0)
        tell(
            min(done, steps), steps,
            f"acceptance {acceptance:.2f}, divergences {100 * divergent:.2g} %, {to_go:.0f} s to go",
        )  # fmt: skip
    return tuple(
        np.concatenate(parts)[:steps].swapaxes(0, 1) for parts in zip(*blocks, strict=True)
    )


def _first(density: Any, away: Array, parameters: int) -> Array:
    """A start more than 10 + 3 per parameter below the fit comes halfway back, lest it stays there."""
    look = jax.jit(jax.vmap(density))
    floor = look(jnp.zeros_like(away))[0] - 10 - 3 * parameters
    for _ in range(60):
        low = look(away) < floor
        away = jnp.where(low[:, None], away / 2, away)
    return away
