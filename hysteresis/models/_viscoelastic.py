"""Viscoelastic models: one exact step for all of them, in both directions."""

import abc
from functools import partial
from typing import Any, NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._errors import InputError
from .._model import AbstractModel, Series, is_start, time_steps
from .._parameter import Scalar, is_concrete
from ..numerics._recurrence import Rows, coupled_recurrence, even_recurrence, linear_recurrence
from ._viscoelastic_chain import Chain, Hold, exact_step

POSITIVE = (0.0, float("inf"))
STIFFNESS, VISCOSITY = "force / displacement", "force * time / displacement"


class ViscoelasticState(NamedTuple):
    """Time, load and the branches' states (n,) after a sample. `t` is NaN before the first.

    The load is what drives the branches: force where they creep, displacement where they relax.
    """

    t: Array
    load: Array
    branches: Array


State = TypeVar("State", bound=ViscoelasticState)


class ViscoelasticInput(NamedTuple):
    """Steps dt, inputs, the inputs before them, where sequences start, and the state they start in.

    Under an even clock dt is one number: every sequence then starts at rest, with a step of 0.
    """

    dt: Array
    u: Array
    u_before: Array
    start: Array
    state: ViscoelasticState


class AbstractViscoelastic(AbstractModel[State, ViscoelasticInput]):
    """A `Chain` driven from either side, plus an offset. Nothing is strained before the first sample;
    a first input other than zero is a jump. Steps are exact at any, also uneven, spacing.

    - `creeps`: the chain runs force -> displacement, else displacement -> force.
    - `leading`: the output leads the input: displacement -> force. Against the chain's own direction
      each step solves its last equation for the load, so that is the exact algebraic inverse.
    - `hold`: the load between samples, `"linear"` or `"constant"`.
    """

    creeps: eqx.AbstractClassVar[bool]
    state_type: eqx.AbstractClassVar[type[ViscoelasticState]]

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

    def init(self, t0: Any = None, u0: Any = None) -> State:
        chain = self.chain()
        zero, rest = jnp.zeros_like(chain.direct), jnp.zeros_like(chain.all_rates)
        return self._state(zero + (jnp.nan if t0 is None else t0), zero, rest)

    def step(self, state: State, t: Any, u: Any) -> tuple[State, Float[Array, ""]]:
        dt = jnp.where(jnp.isnan(state.t), 0.0, t - state.t)
        chain = self.chain()
        decay, before, now = exact_step(chain.all_rates, chain.all_drives, dt, self.hold)
        known = decay * state.branches + before * state.load
        load = jnp.asarray(u)
        if self.against_chain:
            load = (u - known.sum()) / (chain.direct + now.sum())
        after = self._state(jnp.asarray(t, dt.dtype), load, known + now * load)
        return after, self.output(after) + jnp.asarray(self.offset)

    def prepare(
        self,
        t: Series | None,
        u: Series,
        state: State | None = None,
        *,
        starts: tuple[int, ...] = (0,),
    ) -> ViscoelasticInput:
        if t is None:
            raise InputError(
                "no-time",
                f"{type(self).__name__} depends on the rate, and this record has no time.",
                fix="name the time column (--time COL) or the sampling step (--dt SECONDS).",
            )
        u = jnp.asarray(u)
        t = jnp.asarray(t, u.dtype)
        state = self.init() if state is None else state
        first = jnp.asarray(starts)
        dt = time_steps(t, state.t, starts)
        if all(map(is_concrete, (t, state.t, state.branches))):
            dt = _one_step(t, dt, state, starts)
        # Against its chain a model's last input is what the chain last answered.
        u_last = self.answer(state) if self.against_chain else state.load
        u_before = jnp.concatenate([u[:1], u[:-1]]).at[first].set(u_last)
        return ViscoelasticInput(dt, u, u_before, is_start(u.shape[0], starts), state)

    def evaluate(self, prepared: ViscoelasticInput) -> Float[Array, " samples"]:
        dt, u, u_before, start, state = prepared
        chain = self.chain()
        direct, rates, drives = chain.direct, chain.all_rates, chain.all_drives
        begin = state.branches
        if dt.ndim == 0 and not self.against_chain:

            def answer(rates: Array, drives: Array) -> Array:
                steps = tuple(zip(*exact_step(rates, drives, dt, self.hold), strict=True))
                return _even(steps, (u_before, u), 1 - start)

            y = direct * u + answer(chain.rates, chain.drives) + self.offset
            if chain.flow is None:
                return y
            # What flows depends on no other parameter: mapped over many, it is done once.
            return y + chain.flow * answer(jnp.zeros(1, u.dtype), jnp.ones(1, u.dtype))
        dt = dt * (1 - start) if dt.ndim == 0 else dt
        if not self.against_chain:
            branches, inputs = (rates, drives, begin), (dt, u, u_before, start)
            states = _branch_states(self.hold, branches, inputs)
            return direct * u + sum(states, start=jnp.zeros_like(u)) + self.offset
        # The load before = (u before - sum of x) / direct removes the load from the recurrence in x.
        decay, before, now = exact_step(rates[None], drives[None], dt[:, None], self.hold)
        gain = now / (direct + now.sum(-1, keepdims=True))
        before = (before - gain * before.sum(-1, keepdims=True)) / direct
        matrix = decay[:, :, None] * jnp.eye(len(begin))[None]
        matrix -= gain[:, :, None] * decay[:, None, :] + before[:, :, None]
        drive = gain * u[:, None] + before * u_before[:, None]
        drive += start[:, None] * (matrix * begin[None, None]).sum(-1)
        x = coupled_recurrence(matrix * (1 - start)[:, None, None], drive)
        return (u - x.sum(-1)) / direct + self.offset

    def answer(self, state: State) -> Array:
        """What the chain answers after a sample: displacement where it creeps, else force."""
        return self.chain().direct * state.load + state.branches.sum()

    def output(self, state: State) -> Array:
        """The output after a sample, without the offset."""
        return state.load if self.against_chain else self.answer(state)

    def creep_compliance(self, t: Any) -> Array:
        """J(t): displacement under a unit force applied at t = 0."""
        return self._driven_by_force(True).to_step(t)

    def relaxation_modulus(self, t: Any) -> Array:
        """G(t): force under a unit displacement applied at t = 0."""
        return self._driven_by_force(False).to_step(t)

    def ramp(self, t: Any) -> Array:
        """Output, without the offset, under an input that rises by 1 per unit of time from t = 0."""
        return self._driven_by_force(not self.leading).to_ramp(t)

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

    def _driven_by_force(self, force: bool) -> Chain:
        chain = self.chain()
        return chain if force == self.creeps else chain.turned()

    def _state(self, t: Array, load: Array, branches: Array) -> Any:
        return self.state_type(t, load, branches)


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


def _one_step(t: Array, dt: Array, state: ViscoelasticState, starts: tuple[int, ...]) -> Array:
    """The step of an even clock, whose steps differ by no more than the times' rounding; else dt."""
    steps = np.delete(np.asarray(dt), starts)
    at_rest = not np.any(np.asarray(dt)[list(starts)]) and not np.any(np.asarray(state.branches))
    if not at_rest or not len(steps):
        return dt
    rounding = 4 * np.finfo(steps.dtype).eps * np.abs(np.asarray(t)).max()
    return jnp.mean(steps) if np.ptp(steps) <= rounding else dt


def check_positive(**values: Any) -> None:
    """Raise `InputError` where a modulus, viscosity or time is not positive; None is not there."""
    for name, value in values.items():
        if is_concrete(value) and not (np.asarray(value) > 0).all():
            raise InputError(
                "parameter-out-of-bounds",
                f"{name} = {value}: moduli, viscosities and times are positive.",
                cause="a sign or a unit slipped.",
                fix=f"give {name} > 0; an element that is not there is left out, or in series very large.",
            )


def check_lengths(**values: Any) -> None:
    """Raise `InputError` where arrays that describe the same branches differ in length."""
    shapes = {name: getattr(value, "shape", None) for name, value in values.items()}
    if len(set(shapes.values())) > 1 or None in shapes.values() or () in shapes.values():
        raise InputError(
            "length-mismatch",
            f"the shapes of {' and '.join(shapes)} are {' and '.join(map(str, shapes.values()))}.",
            fix=f"give one-dimensional {' and '.join(shapes)}, one value of each for every branch.",
        )
