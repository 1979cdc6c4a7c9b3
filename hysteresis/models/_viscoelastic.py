"""Viscoelastic models: one exact step for all of them, in both directions."""

import abc
import math
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy
from jaxtyping import Array, Float

from .._model import AbstractModel, Series, Tree, is_start, needed_time, one_column, time_steps
from .._parameter import POSITIVE, Scalar, Starts, Times, array_module, as_array, is_concrete
from .._registry import register
from ..numerics._even_clock import even_step
from ..numerics._recurrence import Rows, even_recurrence, linear_recurrence
from ..running import numbers_of, outputs, place_of
from ..trees import node

if TYPE_CHECKING:
    Known = Any  # the operators of the two libraries have no type in common
else:
    Known = Array | np.ndarray | np.generic


# A spring and branches that relax, each on its own: what every viscoelastic model is underneath.

Hold = Literal["linear", "constant"]
"""An array, of NumPy where the parameters are known."""


@register
class Chain(NamedTuple):
    """A linear element with decoupled internal states, all at rest where it has had no input:

        x_0' = flow u,    x_k' = drives_k u - rates_k x_k,    y = direct u + sum of x

    - `direct`: the answer at once.
    - `rates` (n,): 1 / time constant, at least 0.
    - `drives` (n,): all positive, so that the output lags (creep), or all negative (relaxation).
    - `flow`: drive of a branch that keeps what it has, the first one; None for no such branch.
    """

    direct: Float[Known, ""]
    rates: Float[Known, " branches"]
    drives: Float[Known, " branches"]
    flow: Float[Known, ""] | None = None

    @property
    def all_rates(self) -> Known:
        """Rates of all branches, 0 for the one that flows."""
        if self.flow is None:
            return self.rates
        xp = self._module
        return xp.append(xp.zeros_like(self.flow), self.rates)

    @property
    def all_drives(self) -> Known:
        """Drives of all branches."""
        return self.drives if self.flow is None else self._module.append(self.flow, self.drives)

    @property
    def _module(self) -> Any:
        return jnp if isinstance(self.rates, jax.Array) else np

    def to_step(self, t: Any) -> Array:
        """Output after a unit step at t = 0: direct + sum of drive t phi(rate t)."""
        t = jnp.asarray(t, self.direct.dtype)
        return self.direct + self._sum(t, lambda r, d: d * t * moments(r * t)[1])

    def to_ramp(self, t: Any) -> Array:
        """Output under the input t from t = 0 on: direct t + sum of drive t^2 psi(rate t)."""
        t = jnp.asarray(t, self.direct.dtype)
        return self.direct * t + self._sum(t, lambda r, d: d * t**2 * moments(r * t)[2])

    def at_frequency(self, omega: Any) -> Array:
        """Complex output over input exp(i omega t): direct + sum of drive / (rate + i omega)."""
        w = jnp.asarray(omega, self.direct.dtype)
        real = self._sum(w, lambda r, d: d * r / (r**2 + w**2))
        imaginary = self._sum(w, lambda r, d: -d * w / (r**2 + w**2))
        return jax.lax.complex(self.direct + real, imaginary)

    def turned(self) -> "Chain":
        """The same element driven from its other side, u from y, decoupled again.

        Its states move by -(diag(rates) + drives 1^T / direct), which scaling by sqrt|drives| makes
        symmetric; with eigenvalues mu_k and orthonormal eigenvectors v_k of that,

            direct' = 1 / direct,    rates' = mu,    drives'_k = -+ (v_k . sqrt|drives|)^2 / direct^2.

        mu is right to rounding of its largest.
        """
        drives = self.all_drives
        root, sign = jnp.sqrt(jnp.abs(drives)), jnp.sign(drives)
        matrix = jnp.diag(self.all_rates) + jnp.outer(sign * root, root) / self.direct
        mu, v = jnp.linalg.eigh(matrix)
        turned = -sign * jnp.square((v * root[:, None]).sum(0) / self.direct)
        # What never relaxes, a dashpot by itself, comes out as rounding of either sign.
        return Chain(1 / self.direct, jnp.maximum(mu, 0.0), turned)

    def largest_stable_step(self, hold: Hold) -> float:
        """The largest even step at which running the other way round does not grow.

        Infinite for `hold="linear"`. For `hold="constant"` each step's matrix
        diag(decay) - before 1^T / direct passes the eigenvalue -1 where

            sum of before_k / (1 + decay_k) = sum of drive_k dt/2 tanhc(rate_k dt/2) = direct,

        tanhc(x) = tanh(x) / x. The left side grows with dt.
        """
        parts = self.direct, self.all_rates, self.all_drives
        direct, rates, drives = (np.asarray(part, float) for part in parts)
        still = rates == 0
        safe = np.where(still, 1.0, rates)

        def beyond(dt: float) -> float:
            return float(drives @ np.where(still, dt / 2, np.tanh(safe * dt / 2) / safe) - direct)

        bounded = not (drives * still).any() and (drives / safe).sum() <= direct
        if hold == "linear" or bounded:
            return float("inf")
        high = float(2 * direct / drives.sum())
        while beyond(high) <= 0:
            high *= 2
        return float(scipy.optimize.brentq(beyond, 0.0, high, xtol=1e-300, rtol=1e-15))

    def _sum(self, at: Array, answer: Callable[[Array, Array], Array]) -> Array:
        """Of every branch's answer, from its rate and its drive, of the shape of `at`."""
        return sum(map(answer, self.all_rates, self.all_drives), start=jnp.zeros_like(at))


class Step(NamedTuple):
    """An exact step of a branch: x = decay * x + before * (input before) + now * (input now)."""

    decay: Float[Array, " *steps"]
    before: Float[Array, " *steps"]
    now: Float[Array, " *steps"]


def exact_step(rate: Array, drive: Array, dt: Array, hold: Hold) -> Step:
    """The exact step over dt for an input that is linear, or keeps its first value, within it."""
    decay, phi, psi = moments(rate * dt)
    swept = drive * dt
    if hold == "constant":
        return Step(decay, swept * phi, jnp.zeros_like(swept))
    return Step(decay, swept * (phi - psi), swept * psi)


EvenSteps = tuple[tuple[Array, Array, Array], ...]
"""Of every branch an even step: z becomes a z + b (input before) + c (input now)."""


def along(rates: Array, drives: Array, dt: Array, hold: Hold) -> EvenSteps:
    """The steps of the branches of a chain under an even clock."""
    return tuple(zip(*exact_step(rates, drives, dt, hold), strict=True))


SOLVED = 2
"""Branches, at most, of which `against` knows the steps in closed form."""


def against(direct: Array, rates: Array, drives: Array, dt: Array, hold: Hold) -> EvenSteps:
    """The steps of a chain of one or two branches that is driven from its other side, under an even clock:

        load = u / direct + sum of z.

    With p and q the drives of a step by the load before and now, delta = 1 - decay, beta = p + q - delta q
    and d' = direct + sum of q, the states x - q load move by the symmetric matrix
    diag(delta) + sqrt(beta beta^T) / d', up to the sign of the drives. Its eigenvalues nu solve

        sum over branches of beta / (nu - delta) = d',

    and a = 1 - nu, c = -Q / (direct T), b = -(a c + 1 / T), with T = sum of beta / (nu - delta)^2 and
    Q = sum of q / (nu - delta). Differences nu - delta are formed without cancellation, so that steps far
    shorter than the time constants lose nothing.

    Source: Golub, Some modified matrix eigenvalue problems, SIAM Review 15 (1973), section 5.
    """
    _, before, now = exact_step(rates, drives, dt, hold)
    delta = -jnp.expm1(-rates * dt)
    beta = before + now - delta * now
    whole = direct + now.sum()

    def weights(nu: Array, over: Array, gain: Array) -> tuple[Array, Array, Array]:
        """From nu, Q / T and 1 / T."""
        a, c = 1 - nu, -over / direct
        return a, -(a * c + gain), c

    if len(rates) == 1:
        return (weights(delta[0] + beta[0] / whole, now[0] / whole, beta[0] / whole**2),)
    share, signs = beta / whole, np.array([1.0, -1.0])
    sign, half = jnp.sign(beta.sum()), (signs * (delta + share)).sum() / 2
    coupling = share.prod()
    root, turned = jnp.sqrt(half**2 + coupling), sign * half * signs
    # root - turned without cancellation: the farther root's distances from both deltas, but for the share.
    beyond = jnp.where(turned > 0, coupling / (root + jnp.abs(turned)), root - turned)
    far = sign * beyond + share
    part = share / far
    other, swapped = jnp.flip(part), jnp.flip(far)
    weight = whole * (part * swapped).sum()
    apart = -(signs * delta).sum()
    outer = weights((delta + far)[0], (now * swapped).sum() / weight, far.prod() / weight)
    # The nearer root lies between the deltas.
    inner = weights(
        (delta * other).sum(),
        apart * (signs * now * other).sum() / weight,
        apart**2 * part.prod() / weight,
    )
    return outer, inner


@jax.custom_jvp
def moments(x: Array) -> tuple[Array, Array, Array]:
    """exp(-x), phi(x) = (1 - exp(-x)) / x and psi(x) = (1 - phi(x)) / x to rounding, at any x >= 0."""
    return _moments(x)[:3]


@moments.defjvp
def _slopes(x: tuple[Array], dx: tuple[Array]) -> Any:
    """phi' = psi - phi and psi' = 2 chi - psi, with chi(x) = (1/2 - psi(x)) / x."""
    decay, phi, psi, chi = _moments(x[0])
    return (decay, phi, psi), (-decay * dx[0], (psi - phi) * dx[0], (2 * chi - psi) * dx[0])


@partial(jax.jit, inline=True)
def _moments(x: Array) -> tuple[Array, Array, Array, Array]:
    # Below 0.1 chi by its series, 1/3! - x/4! + ...: the first term left out is 0.1^9 / 12! = 2e-18.
    small = x < 0.1
    chi = jnp.full_like(x, 1 / math.factorial(11))
    for k in range(10, 2, -1):
        chi = 1 / math.factorial(k) - x * chi
    over = 1 / jnp.where(small, 1.0, x)
    decay = jnp.exp(-x)
    psi = 0.5 - x * chi
    phi = jnp.where(small, 1 - x * psi, (1 - decay) * over)
    psi = jnp.where(small, psi, (1 - phi) * over)
    return decay, phi, psi, jnp.where(small, chi, (0.5 - psi) * over)


MODULUS: dict[str, Any] = POSITIVE | {"at": "high"}
"""Of moduli, viscosities and times: an infinite one is an element that does not give way."""

STIFFNESS, VISCOSITY = "force / displacement", "force * time / displacement"


class ViscoelasticState(NamedTuple):
    """Time, load and the branches' states (n,) after a sample. `t` is NaN before the first.

    The load is what drives the branches: force where they creep, displacement where they relax.
    """

    t: Known
    load: Known
    branches: Known


class ViscoelasticInput(NamedTuple):
    """Steps dt, inputs, the inputs before them, where sequences start, and the state they start in.

    Under an even clock, see `even_step`, dt is one number: every sequence then starts at rest, with a step
    of 0.
    """

    dt: Array
    u: Array
    u_before: Array
    start: Array
    state: ViscoelasticState


class AbstractViscoelastic(AbstractModel[ViscoelasticState, ViscoelasticInput]):
    """A `Chain` driven from either side, plus an offset. Nothing is strained before the first sample;
    a first input other than zero is a jump. Steps are exact at any, also uneven, spacing. Where the printed
    digits of the times cannot tell a clock from an even one, it is even: outputs differ by less than the
    last digit of the times, a tenth of a step at most, times the rate at which they change.

    - `creeps`: the chain runs force -> displacement, else displacement -> force.
    - `leading`: the output leads the input: displacement -> force. Against the chain's own direction
      each step solves its last equation for the load, so that is the exact algebraic inverse.
    - `hold`: the load between samples, `"linear"` or `"constant"`.
    """

    creeps: eqx.AbstractClassVar[bool]

    # Fields of every model, with defaults. As annotations they would come before its own in type
    # checkers' view of `__init__`.
    @property
    @abc.abstractmethod
    def offset(self) -> Scalar: ...

    @property
    @abc.abstractmethod
    def leading(self) -> bool: ...

    @property
    @abc.abstractmethod
    def hold(self) -> Hold: ...

    @abc.abstractmethod
    def chain(self) -> Chain:
        """The decoupled branches, driven by force where the model `creeps`, else by displacement."""

    def init(self, t0: Any = None, u0: Any = None) -> ViscoelasticState:
        chain = self.chain()
        xp = array_module(chain.direct, chain.all_rates)
        zero, rest = xp.zeros_like(chain.direct), xp.zeros_like(chain.all_rates)
        return ViscoelasticState(zero + (np.nan if t0 is None else t0), zero, rest)

    def step(
        self, state: ViscoelasticState, t: Any, u: Any
    ) -> tuple[ViscoelasticState, Float[Array, ""]]:
        dt = jnp.where(t > jnp.asarray(state.t), t - jnp.asarray(state.t), 0.0)
        chain = self._traced_chain()
        decay, before, now = exact_step(chain.all_rates, chain.all_drives, dt, self.hold)
        known = decay * state.branches + before * state.load
        load = jnp.asarray(u)
        if self.against_chain:
            load = (u - known.sum()) / (chain.direct + now.sum())
        after = ViscoelasticState(jnp.asarray(t, dt.dtype), load, known + now * load)
        return after, self.output(after) + jnp.asarray(self.offset)

    def prepare(
        self, t: Times, u: Series, state: ViscoelasticState | None = None, *, starts: Starts = (0,)
    ) -> ViscoelasticInput:
        state = self.init() if state is None else state
        # Known times and inputs are prepared by NumPy: no program is compiled for every number of rows.
        xp, first = array_module(t, u, *state), np.asarray(starts)
        u = xp.asarray(one_column(u), dtype=None if xp is jnp else float)
        times = xp.asarray(needed_time(type(self).__name__, t), dtype=u.dtype)
        dt: Any = time_steps(times, state.t, starts)
        if xp is np and not (np.any(dt[first]) or np.any(state.branches)):
            even = even_step(times, starts)
            dt = dt if even is None else np.asarray(even)
        # Against its chain a model's last input is what the chain last answered.
        u_last = self.answer(state) if self.against_chain else state.load
        u_before = xp.concatenate([u[:1], u[:-1]])
        if xp is np and is_concrete(u_last):
            u_before[first] = u_last
        else:
            u_before = jnp.asarray(u_before).at[first].set(u_last)
        start = is_start(u.shape[0], starts)
        dt, u, u_before, start = map(as_array, (dt, u, u_before, start))
        return ViscoelasticInput(dt, u, u_before, start, state)

    def evaluate(self, prepared: ViscoelasticInput) -> Float[Array, " samples"]:
        dt, u, u_before, start, state = prepared
        chain = self._traced_chain()
        direct, rates, drives = chain.direct, chain.all_rates, chain.all_drives
        begin = jnp.asarray(state.branches)
        if dt.ndim == 0 and not self.against_chain:
            inputs, goes_on = (u_before, u), 1 - start
            y = _even(along(chain.rates, chain.drives, dt, self.hold), inputs, goes_on)
            y += direct * u + self.offset
            if chain.flow is None:
                return y
            # What flows depends on no other parameter: mapped over many, it is done once.
            flow = along(jnp.zeros(1, u.dtype), jnp.ones(1, u.dtype), dt, self.hold)
            return y + chain.flow * _even(flow, inputs, goes_on)
        if dt.ndim == 0 and 0 < len(begin) <= SOLVED:
            steps = against(direct, rates, drives, dt, self.hold)
            return u / direct + _even(steps, (u_before, u), 1 - start) + self.offset
        dt = dt * (1 - start) if dt.ndim == 0 else dt
        if not self.against_chain:
            branches, inputs = (rates, drives, begin), (dt, u, u_before, start)
            states = _branch_states(self.hold, branches, inputs)
            return direct * u + sum(states, start=jnp.zeros_like(u)) + self.offset
        # The load follows from all branches at once, which the law does sample by sample.
        numbers = numbers_of(self.tree())
        m = jnp.asarray(numbers.m)
        for name, value in (("load", state.load), ("x", begin)):
            place = place_of(numbers.known, name)
            m = m.at[place : place + jnp.size(value)].set(value)
        since = jnp.where(start == 0, dt, jnp.where(dt > 0, -dt, jnp.nan))
        return outputs(numbers._replace(m=m), u, since)[0]

    def laws(self, eps: float, depth: int) -> Tree:
        chain = self._traced_chain()
        none = np.zeros(len(chain.all_rates))
        return node(
            "chain",
            {
                "branches": len(none), "direct": chain.direct, "rates": chain.all_rates,
                "drives": chain.all_drives, "against": self.against_chain,
                "constant": self.hold == "constant", "offset": self.offset,
            },
            {"load": 0.0, "x": none, "dt": -1.0, "decay": none, "before": none, "now": none},
        )  # fmt: skip

    def answer(self, state: ViscoelasticState) -> Known:
        """What the chain answers after a sample: displacement where it creeps, else force."""
        return self.chain().direct * state.load + state.branches.sum()

    def output(self, state: ViscoelasticState) -> Known:
        """The output after a sample, without the offset."""
        return state.load if self.against_chain else self.answer(state)

    def creep_compliance(self, t: Any) -> Array:
        """J(t): displacement under a unit force applied at t = 0."""
        return self.driven_by_force(True).to_step(t)

    def relaxation_modulus(self, t: Any) -> Array:
        """G(t): force under a unit displacement applied at t = 0."""
        return self.driven_by_force(False).to_step(t)

    def ramp(self, t: Any) -> Array:
        """Output, without the offset, under an input that rises by 1 per unit of time from t = 0."""
        return self.driven_by_force(not self.leading).to_ramp(t)

    def complex_modulus(self, omega: Any) -> Array:
        """G' + i G'' at an angular frequency omega: complex force over displacement."""
        answer = self.chain().at_frequency(omega)
        return 1 / answer if self.creeps else answer

    def largest_stable_step(self) -> float:
        """The largest even step at which running against the chain's own direction does not grow."""
        return self.chain().largest_stable_step(self.hold)

    @property
    def against_chain(self) -> bool:
        """Whether the model runs against its chain's own direction."""
        return self.leading == self.creeps

    def _traced_chain(self) -> Chain:
        return jax.tree.map(jnp.asarray, self.chain())

    def driven_by_force(self, force: bool) -> Chain:
        """The chain from force to displacement, or else from displacement to force."""
        chain = self._traced_chain()
        return chain if force == self.creeps else chain.turned()


Branches = tuple[Array, Array, Array]
"""Rates, drives and first states."""

Inputs = tuple[Array, Array, Array, Array]
"""Steps, inputs, the inputs before them, and where sequences start."""


@partial(jax.custom_jvp, nondiff_argnums=(0,))
def _at_once(hold: Hold, branches: Branches, inputs: Inputs) -> Rows:
    steps = [_recurrence(hold, inputs, branch) for branch in zip(*branches, strict=True)]
    return linear_recurrence(tuple(a for a, _ in steps), tuple(b for _, b in steps))


@_at_once.defjvp
def _one_by_one(
    hold: Hold, primals: tuple[Branches, Inputs], tangents: tuple[Branches, Inputs]
) -> tuple[Rows, Rows]:
    # One branch after the other, and what its derivative needs computed again from the few arrays that all
    # share: half of a gradient's time was memory taken for the first time.
    def states(branches: Branches, inputs: Inputs) -> Rows:
        a, b = jax.lax.map(jax.checkpoint(partial(_recurrence, hold, inputs)), branches)
        return linear_recurrence(tuple(a), tuple(b))

    return jax.jvp(states, primals, tangents)


def _recurrence(hold: Hold, inputs: Inputs, branch: Branches) -> tuple[Array, Array]:
    (dt, u, u_before, start), (rate, drive, begin) = inputs, branch
    decay, before, now = exact_step(rate, drive, dt, hold)
    return decay * (1 - start), before * u_before + now * u + decay * start * begin


_branch_states = jax.jit(_at_once, static_argnums=0)
"""The states of all branches after every sample; each sequence begins in their first ones."""


_even = jax.jit(even_recurrence)
