"""Levenberg-Marquardt of optimistix, which stops where the data identify nothing more."""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix
from jaxtyping import Array, Bool, Float, Int

from .._levels import ROUNDING, STILL

PATIENCE = 10
"""Steps in a row that may fail to lower the sum of squares by the share `STILL`."""

OPEN = 10.0
"""Standard error on the unconstrained scale, a factor of exp(10), beyond which a direction is not
identified: what could still be gained along it does not keep the search going."""


class Factors(eqx.Module):
    """J = U diag(sizes) vectors' of the Jacobian at the present point, and U' times the residuals."""

    sizes: Float[Array, " parameters"]
    vectors: Float[Array, "parameters parameters"]
    along: Float[Array, " parameters"]


class SingularDescent(optimistix.AbstractDescent):
    """The damped step -(J'J + damping)^-1 J'r from one factorisation of J, which serves every damping.

    Trial steps that are rejected cost no factorisation, and the same factors tell the reduction that is
    left. A triangle of [J r] comes first, so that only a small matrix has singular values to find.
    """

    def init(self, y: Array, f_info_struct: Any) -> Factors:
        del f_info_struct
        return Factors(jnp.zeros_like(y), jnp.zeros((y.size, y.size), y.dtype), jnp.zeros_like(y))

    def query(self, y: Array, f_info: Any, state: Factors) -> Factors:
        del state
        columns = jax.vmap(f_info.jac.mv)(jnp.eye(y.size, dtype=y.dtype))
        both = jnp.concatenate([columns, f_info.residual[None]]).T
        triangle = jnp.linalg.qr(both, mode="r")
        U, sizes, vectors = jnp.linalg.svd(triangle[: y.size, : y.size])
        return Factors(sizes, vectors.T, U.T @ triangle[: y.size, y.size])

    def step(self, step_size: Array, state: Factors) -> tuple[Array, Any]:
        gain = state.sizes / (state.sizes**2 + 1 / step_size)
        return -state.vectors @ (gain * state.along), optimistix.RESULTS.successful


class TrustRegion(optimistix.ClassicalTrustRegion):
    """It begins with a damping of a hundredth, as residuals and parameters are relative, and weakens it
    where a step keeps three quarters of its promise. That takes half the steps of 1 and 99 per cent."""

    def init(self, y: Array, f_info_struct: Any) -> Any:
        begin = super().init(y, f_info_struct)
        return eqx.tree_at(lambda state: state.step_size, begin, jnp.asarray(100.0, y.dtype))


class _State(eqx.Module):
    """That of Gauss and Newton, the least sum of squares so far, and steps in a row without a gain."""

    inner: Any
    least: Float[Array, ""]
    still: Int[Array, ""]


class LevenbergMarquardt(optimistix.AbstractGaussNewton):
    """Levenberg-Marquardt for parameters on an unconstrained scale, of which the data may not identify all.

    It converges where a Gauss-Newton step along the identified directions would lower the sum of squares by
    less than its precision, or where `PATIENCE` steps in a row have lowered it by less than `STILL`.
    Along a direction whose standard error is beyond `OPEN` a parameter may go to infinity, each step lowers
    the cost by less, and none of it means anything: these directions are left out.

    - `rows`: how many residuals count. `limit`: steps at most, an array, which is no part of a program.

    Source: Nocedal, Wright, Numerical Optimization (2006), section 10.3; the damping follows optimistix.
    """

    rows: Array
    limit: Array
    rtol: float = ROUNDING
    atol: float = ROUNDING
    norm: Callable[[Any], Array] = eqx.field(default=optimistix.max_norm, static=True)
    descent: Any = SingularDescent()
    search: Any = TrustRegion(high_cutoff=0.75)
    verbose: Any = eqx.field(default=lambda **_: None, static=True)

    def init(self, fn, y, args, options, f_struct, aux_struct, tags) -> Any:
        inner = super().init(fn, y, args, options, f_struct, aux_struct, tags)
        return _State(inner, jnp.asarray(jnp.inf, y.dtype), jnp.zeros((), int))

    def step(self, fn, y, args, options, state: Any, tags) -> Any:
        y, inner, aux = super().step(fn, y, args, options, state.inner, tags)
        squares = jnp.sum(inner.f_info.residual**2)
        gained = squares < (1 - STILL) * state.least
        still = jnp.where(gained, 0, state.still + 1)
        return y, _State(inner, jnp.minimum(squares, state.least), still), aux

    def terminate(self, fn, y, args, options, state: Any, tags) -> Any:
        inner, factors = state.inner, state.inner.descent_state
        squares = jnp.sum(inner.f_info.residual**2)
        eps = jnp.finfo(squares.dtype).eps
        identified = factors.sizes * OPEN * jnp.sqrt(self.rows) >= jnp.sqrt(squares)
        left = jnp.sum(jnp.where(identified, factors.along, 0.0) ** 2)
        # Rounding leaves a share of the sum of squares, and all there is of exact data.
        enough = eps * squares + (100 * eps) ** 2
        done = (inner.num_steps > 0) & ((left <= enough) | (state.still >= PATIENCE))
        spent = (inner.num_steps >= self.limit) & ~done
        failed = optimistix.RESULTS.nonlinear_max_steps_reached
        return done | spent, optimistix.RESULTS.where(spent, failed, inner.result)


class Found(NamedTuple):
    """Where a search ended: the point, residuals and Jacobian there, what else the function returned,
    whether the search converged, and the steps it took."""

    free: Float[Array, " parameters"]
    residuals: Float[Array, " rows"]
    jacobian: Float[Array, "rows parameters"]
    beside: Any
    converged: Bool[Array, ""]
    steps: Int[Array, ""]


def least_squares(
    residuals: Callable[[Array, Any], tuple[Array, Any]],
    z: Array,
    arguments: Any,
    rows: Any,
    limit: Any,
) -> Found:
    """Levenberg-Marquardt from z, at most `limit` steps; one step evaluates at z and moves nowhere.

    `residuals(z, arguments)` gives the residuals, relative to the output's range, and anything beside them.
    """

    @eqx.filter_custom_jvp
    def once(z: Array, *, arguments: Any) -> tuple[Array, Any]:
        return residuals(z, arguments)

    # A step needs the Jacobian several times. As a matrix it is computed, and compiled, once.
    @once.def_jvp
    def _(primals: Any, tangents: Any, *, arguments: Any) -> tuple[Any, Any]:
        (z,), (dz,) = primals, tangents
        r, push, beside = jax.linearize(lambda z: residuals(z, arguments), z, has_aux=True)
        columns = jax.vmap(push)(jnp.eye(z.size, dtype=z.dtype))
        return (r, beside), (dz @ columns, jax.tree.map(jnp.zeros_like, beside))

    solution = optimistix.least_squares(
        lambda z, arguments: once(z, arguments=arguments),
        LevenbergMarquardt(rows=jnp.asarray(rows, z.dtype), limit=jnp.asarray(limit)),
        z,
        args=arguments,
        has_aux=True,
        max_steps=None,
        throw=False,
    )
    end = solution.state.inner
    # A start that is not finite was not even tried.
    residual = jnp.where(end.num_steps > 0, end.f_info.residual, jnp.nan)
    columns = jax.vmap(end.f_info.jac.mv)(jnp.eye(z.size, dtype=z.dtype))
    converged = solution.result == optimistix.RESULTS.successful
    return Found(solution.value, residual, columns.T, end.aux, converged, end.num_steps)
