"""An inverse that knows of noise: the model inside a filter of its input."""

from collections.abc import Callable
from math import inf, nan
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import ArrayLike

from hysteresis import AbstractModel, InputError
from hysteresis._parameter import is_concrete
from hysteresis._type_variables import PyTree
from hysteresis.laws import filtered as law
from hysteresis.running import Known, Numbers, numbers_of, place_of, told
from hysteresis.trees import node

from .._contract import AbstractCompensator, Status
from .._readings import with_reading
from ..inverses import inverse_of
from ..inverses._law import OWN, LawCompensator, goes_back_only, told_of_condition
from ._ensemble import UncertainEstimate


class FilteredState(NamedTuple):
    """What the law remembers, when the last reading came, NaN before the first, and the last estimate.

    Of a model without laws: its state, that of its inverse, and value, variance and whether there was any.
    """

    memory: PyTree
    t: Float[Array, ""]
    value: Float[Array, ""]


class FilteredCompensator(AbstractCompensator[FilteredState, UncertainEstimate]):
    """An extended Kalman filter of the input, for noisy readings.

    It finds the input that is likeliest if it walks at random and the reading is noisy:

        u_k = u_(k-1) + N(0, Q),     y_k = h(u_k) + N(0, R),     R = output_sigma^2,

    with h the model's next output from where it is, and Q = input_step^2 a sample, or input_step^2 dt
    where `by_time`. A sample is one update of an extended Kalman filter, variance P:

    - P += Q, and H is the slope of the chord of h across u +- sqrt(P): a branch either way. A loop as
      wide as u was uncertain, up and back, opens by 2 d: what h owes to turns not seen, R += d^2.
    - u += k (h^-1(y) - u), k = H^2 P / (H^2 P + R), towards the raw inverse, and so onto it where R
      is small. P = 1 / (1/P + H^2 / R), H again about the new u, the lesser; there the corner between the
      branches is noise too.
    - The model and its inverse go on to the filtered u: noise makes no reversals in their memory.

    The deviation sqrt(P) says what noise does to an input that moves like that; one that moves faster
    lags behind, and what is wrong with the model is not in it. On lagging Preisach and Burgers models and
    walks of these statistics 90 % bands held 89 to 94 %, on a leading Preisach model 84 %: h after
    turns that were not seen is known to first order only. The status is the raw inverse's.

    The law is `hysteresis/laws/filtered.py`: a reading costs microseconds. A model without laws is filtered
    outside of JAX's programs, at twelve of its steps a reading.

    **Arguments:**

    - `model`: as for `invert`. `input_step`: standard deviation of the input's step per sample (or per
      square root of time). `output_sigma`: of the reading's noise.

    **Other arguments:**

    - `by_time`: steps grow with the square root of the time between samples, which is then needed.
    - `inverse`: of the model, if not `invert`'s.

    Raises `InputError` for deviations that are not positive and finite, and a model without inverse.

    **Example:**

        >>> smooth = compensate.FilteredCompensator(model, input_step=1.0, output_sigma=0.01)
        >>> smooth.simulate(t, model.simulate(t, u)).deviation.shape
        (13,)
    """

    model: AbstractModel
    raw: AbstractCompensator
    input_step: Float[Array, ""]
    output_sigma: Float[Array, ""]
    by_time: bool = eqx.field(static=True)
    numbers: Float[Array, " numbers"] | None
    known: Known | None = eqx.field(static=True)

    def __init__(
        self,
        model: AbstractModel,
        input_step: ArrayLike,
        output_sigma: ArrayLike,
        *,
        by_time: bool = False,
        inverse: Callable[[AbstractModel], AbstractCompensator] = inverse_of,
    ):
        for name, value in {"input_step": input_step, "output_sigma": output_sigma}.items():
            if is_concrete(value) and not 0 < float(np.asarray(value)) < float("inf"):
                raise InputError(
                    "parameter-out-of-bounds",
                    f"{name} is {np.asarray(value):g}, and has to be positive and finite.",
                    fix="invert(model) is the inverse that takes every reading at its word.",
                )
        self.model, self.raw, self.by_time = model, inverse(model), by_time
        self.input_step = jnp.asarray(input_step, float)
        self.output_sigma = jnp.asarray(output_sigma, float)

        self.numbers = self.known = None
        raw = self.raw
        if isinstance(raw, LawCompensator) and not goes_back_only(tree := model.tree(depth=OWN)):
            parameters = {
                "step": self.input_step**2, "noise": self.output_sigma**2, "by_time": int(by_time),
            }  # fmt: skip
            kept = np.zeros(2 * raw.known.states)
            state = {"value": raw.held, "variance": inf, "begun": 0, "kept": kept}
            made = numbers_of(node("filtered", parameters, state, [tree, tree]))
            self.numbers, self.known = jnp.asarray(made.m, float), made.known

    def init(self) -> FilteredState:
        never = jnp.asarray(nan, float)
        if self.numbers is None or self.known is None:
            value = jnp.zeros_like(never)
            return FilteredState((self.model.init(), self.raw.init(), 0.0, inf, 0), never, value)
        first = Numbers(self.known, self.numbers).state
        return FilteredState(first, never, self.numbers[place_of(self.known, "value")])

    def stream(
        self, t: ArrayLike | None, y: ArrayLike, state: FilteredState
    ) -> tuple[FilteredState, UncertainEstimate]:
        if t is None and self.by_time:
            raise InputError("no-time", "steps by time need the times.", fix="give t.")
        y = jnp.asarray(y, float)
        times = jnp.zeros(y.shape[:1]) if t is None else jnp.asarray(t, float)
        if self.known is None:
            each: list[tuple[float, int, float]] = []
            for now, reading in zip(times, y, strict=True):
                state, found = self._step_by_step(state, now, reading)
                each.append(found)
            value, status, deviation = jnp.asarray(np.reshape(each, (-1, 3)).T)
            return state, UncertainEstimate(value, status.astype(int), deviation)
        readings = y if y.ndim == 1 else jnp.where(jnp.isfinite(y).all(1, keepdims=True), y, nan)
        found = told(Numbers(self.known, self.numbers), *state, times, readings, width=1)
        value, status, said, memory, last = map(jnp.asarray, found)
        after = FilteredState(memory, last, value[-1] if len(value) else state.value)
        status = told_of_condition(self.model, y, status)
        return after, UncertainEstimate(value, status, said[:, 0])

    def _step_by_step(
        self, state: FilteredState, t: Array, y: Array
    ) -> tuple[FilteredState, tuple[float, int, float]]:
        """One reading of a model without laws: value, status and deviation."""
        model, inverse, *filtered = state.memory
        p, s = law.Parameters(), law.State()
        p.step, p.noise = float(self.input_step) ** 2, float(self.output_sigma) ** 2
        p.by_time = int(self.by_time)
        s.value, s.variance, s.begun = filtered
        found = _step(self.raw, inverse, t, y)[1]
        if not (jnp.isfinite(y).all() and jnp.isfinite(t)):
            held = float(state.value if s.begun else found.value)
            return state, (held, Status.INVALID, law.deviation(s))

        def onward(own: PyTree, u: float) -> tuple[PyTree, Array]:
            return _step(self.model, own, t, with_reading(y, 0, jnp.asarray(u, float)))

        def look(dt: float, u: float) -> float:
            return float(onward(model, u)[1])

        def back(dt: float, u: float) -> float:
            return float(onward(onward(model, u)[0], s.value)[1])

        passed = 0.0 if jnp.isnan(state.t) else max(float(t - state.t), 0.0)
        value = law.likeliest(look, back, p, s, passed, float(found.value))
        moved, output = onward(model, value)
        inverse = _step(self.raw, inverse, t, with_reading(y, 0, output))[0]
        memory = moved, inverse, s.value, s.variance, s.begun
        after = FilteredState(memory, t, jnp.asarray(value))
        return after, (value, int(found.status), law.deviation(s))


@eqx.filter_jit
def _step(
    one: AbstractModel | AbstractCompensator, state: PyTree, t: Array, x: Array
) -> tuple[PyTree, PyTree]:
    return one.step(state, t, x)
