"""Viscoelastic models: one exact step for all of them, in both directions."""

import abc
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._model import (
    AbstractModel,
    Series,
    Tree,
    is_start,
    needed_time,
    one_column,
    time_steps,
)
from .._parameter import POSITIVE, Scalar, array_module, as_array, is_concrete
from .._type_variables import Starts, Times
from ..numerics._even_clock import even_step
from ..numerics._recurrence import Rows, even_recurrence, linear_recurrence
from ..running import numbers_of, outputs, place_of
from ..trees import node
from ._viscoelastic_chain import SOLVED, Chain, Hold, Known, against, along, exact_step

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
