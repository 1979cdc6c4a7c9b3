"""The contract every model keeps, and models written sample by sample, by `init` and `step` alone."""

import abc
from functools import partial
from typing import Any, ClassVar, Generic, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

from ._errors import InputError
from ._parameter import Output, Prepared, Series, Starts, State, Times, array_module, check_bounds
from ._precision import PickledAsItIs, in_own_precision, keep_precision
from ._quantities import Units, as_range, as_units
from ._show import one_line, table

Tree = dict[str, Any]
"""A node of a tree of laws: `kind`, `parameters`, `state`, and `parts` where it has some."""

DOUBLE = 2.0**-52
"""The rounding of numbers in double precision."""


class AbstractModel(PickledAsItIs, eqx.Module, Generic[State, Prepared]):
    """A causal operator from an input history u(t) to an output y(t), with memory.

    Laws that hold for every model, for any times t and inputs u:

        simulate(t, u)            == the outputs of step, one sample after the other
        simulate(t, u)[k:]        == simulate(t[k:], u[k:], state after the first k samples)
        simulate(t, u)            is differentiable in every parameter, and in u by `jax.jvp`

    Models are frozen: `step` returns the next state, a fit returns a new model. They are pytrees,
    so all of `jax.jit`, `jax.vmap` and `jax.grad` apply to them.

    **Fields** of every model, given by name; a fit sets both, and files keep them:

    - `units`: `Units` of input, output and time; None where they are not known.
    - `trained`: (2,), the least and the greatest input that the model was fitted to; None: not known.
    """

    units: Units | None = eqx.field(default=None, static=True, kw_only=True, converter=as_units)
    trained: Float[Array, "2"] | None = eqx.field(default=None, converter=as_range, kw_only=True)

    traced: ClassVar[bool] = True
    """Whether `simulate` compiles `evaluate` by JAX; laws are compiled already."""

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        keep_precision(cls, ("init", "step", "prepare", "evaluate", "simulate", "stream"))

    def __check_init__(self) -> None:
        check_bounds(self)

    @abc.abstractmethod
    def init(self, t0: Any = None, u0: Any = None) -> State:
        """The virgin state just before the first sample; the first step then has dt = 0.

        Neither argument changes what a model has been through: `t0` starts its clock, `u0` is
        there for models whose state needs the input's shape.
        """

    @abc.abstractmethod
    def step(self, state: State, t: Any, u: Any) -> tuple[State, Float[Array, ""]]:
        """One sample in, one sample out: (state, t, u) -> (next state, y)."""

    @abc.abstractmethod
    def prepare(
        self, t: Times, u: Series, state: State | None = None, *, starts: Starts = (0,)
    ) -> Prepared:
        """Everything that depends on the input alone, computed once for many `evaluate`.

        **Arguments:**

        - `t`: times, shape `(samples,)`; None for rate-independent models.
        - `u`: inputs, shape `(samples,)`; `(samples, 2)` for a model that takes a condition too.
        - `state`: where an earlier record ended; None for the virgin state.
        - `starts`: first samples of the independent sequences in `u`: each begins in `state`.

        Raises `InputError` `no-time` where the rate matters and `t` is None.
        """

    @abc.abstractmethod
    def evaluate(self, prepared: Prepared) -> Float[Array, " samples"]:
        """The output at every sample: parallel in time, differentiable in every parameter."""

    @in_own_precision
    def simulate(
        self, t: Times, u: Series, state: State | None = None, *, starts: Starts = (0,)
    ) -> Float[Array, " samples"]:
        """`evaluate(prepare(t, u, state, starts=starts))`, compiled.

        Raises `InputError` as `prepare` does, and `not-finite` where an input is NaN or infinite.
        """
        same_samples(t, u)
        complete(u)
        if not len(u):
            return jnp.zeros(0)
        if (simulated := getattr(self, "simulated", None)) is not None:
            return simulated(t, u, state, starts)
        evaluate: Any = partial(evaluated, self) if self.traced else self.evaluate
        return evaluate(self.prepare(t, u, state, starts=starts))

    @in_own_precision
    def tree(self, eps: float = DOUBLE, depth: int = 64) -> Tree:
        """The model as a tree of laws with their numbers, which runs without JAX.

        It is what the model's own method `laws(eps, depth)` gives, made by `hysteresis.trees`.
        JAX may trace it: numbers that depend on a parameter are arrays of JAX, all others are constants of
        Python or NumPy. Kinds, lengths and the integers among parameters do not depend on values.

        - `eps`: the rounding of the numbers that it is run with.
        - `depth`: reversals that a Preisach model remembers; 0: as many as its own `capacity`.

        Raises `InputError` `not-exportable` where no law is known for the model or one of its parts.

        **Example:**

            >>> tree = hysteresis.LinearSponge(K=2.0).tree()
            >>> tree["kind"], float(tree["parameters"]["K"])
            ('line', 2.0)
        """
        laws: Any = getattr(self, "laws", None)
        if laws is None:
            raise InputError(
                "not-exportable",
                f"{type(self).__name__} cannot be exported.",
                cause="the runtimes without JAX have no element for it.",
                fix="use the compensator itself, or fit a model that can.",
            )
        return laws(eps, depth)

    @in_own_precision
    def state_from(self, t: Times, u: Series, y: Series) -> State:
        """The state after some rows of which the output is known too, whatever was before them.

        The known inputs leave what they have reached. What was there before is estimated: the inputs that
        nobody saw, within the trained range, behind which the model gives the known outputs best.

        **Arguments:** `t`, `u`: as of `simulate`. `y`: outputs (samples,); NaN where one is not known.

        **Returns:** a state for `step`, `stream` and `simulate`.

        **Raises:** `InputError` `no-rows` without a known output, `no-time` as `prepare` does.

        **Example:**

            >>> state = model.state_from(t[3:9], u[3:9], model.simulate(t, u)[3:9])
            >>> bool(np.allclose(model.simulate(t[9:], u[9:], state), model.simulate(t, u)[9:]))
            True
        """
        from ._known_past import known_past  # late: it runs models

        if t is None:
            self.prepare(None, u)  # raises where the rate matters
        past = known_past(self, t, u, y)
        times = None if past.times is None else past.times[0]
        return self.stream(times, past.inputs[0])[0]

    def unit_words(self, input_unit: str, output_unit: str, time_unit: str) -> dict[str, str]:
        """What the words in the parameters' units stand for on a record with these units."""
        force, displacement = input_unit, output_unit
        if getattr(self, "moved_by_force", False):
            # The models inside are hysteretic forces: their input is the displacement.
            mass = f"{force} * {time_unit} * {time_unit} / {displacement}"
            return {
                "input": displacement, "output": force, "time": time_unit, "force": force,
                "displacement": displacement, "mass": "kg" if mass == "N * s * s / m" else mass,
            }  # fmt: skip
        if getattr(self, "leading", False):
            force, displacement = output_unit, input_unit
        return {
            "input": input_unit, "output": output_unit, "time": time_unit,
            "force": force, "displacement": displacement,
        }  # fmt: skip

    def __str__(self) -> str:
        return table(self)

    def __repr__(self) -> str:
        return one_line(self)

    @in_own_precision
    def stream(self, t: Times, u: Series, state: State | None = None) -> tuple[State, Output]:
        """`step` over all samples: (state after the last one, outputs). Slower than `simulate`, but for
        models that run their laws."""
        complete(u)
        if (follow := getattr(self, "follow", None)) is not None:
            return follow(t, u, state)
        u = jnp.asarray(u)
        if t is None:
            self.prepare(None, u)  # raises where the rate matters
            t = jnp.zeros(len(u), u.dtype)
        t = jnp.asarray(t, u.dtype)
        state = self.init() if state is None else state
        return _scan(self, state, t, u)


# A scan that is not compiled is traced again in every call: 0.3 s for 240 samples of Bouc-Wen, not 3 ms.
@eqx.filter_jit
def evaluated(model: AbstractModel, prepared: Any) -> Array:
    return model.evaluate(prepared)


@eqx.filter_jit
def _scan(model: AbstractModel, state: Any, t: Array, u: Array) -> tuple[Any, Array]:
    return jax.lax.scan(lambda carry, sample: model.step(carry, *sample), state, (t, u))


class AbstractFollowingModel(AbstractModel[State, Prepared]):
    """A model that takes all samples at once, with the state after them: a step is a series of one."""

    @abc.abstractmethod
    def follow(self, t: Times, u: Series, state: State | None = None) -> tuple[State, Output]:
        """All samples at once: (state after the last one, outputs)."""

    def step(self, state: State, t: Any, u: Any) -> tuple[State, Float[Array, ""]]:
        times = None if t is None else jnp.asarray(t, float)[None]
        state, y = self.follow(times, jnp.asarray(u, float)[None], state)
        return state, y[0]


def same_samples(t: Any, values: Any) -> None:
    """Raise `InputError`: `length-mismatch` where times are given, but not one for every sample,
    `wrong-shape` of one number, `wrong-unit` of dates, whose numbers may be nanoseconds, `not-numbers`."""
    if not np.ndim(values):
        said = "This is one number, not samples."
        raise InputError("wrong-shape", said, fix="give (samples,), or take a step.")
    if getattr(getattr(t, "dtype", None), "kind", "") in ("m", "M"):
        said = "The times are dates or durations, not numbers."
        fix = 'give seconds, or another unit: (t - t[0]) / np.timedelta64(1, "s").'
        raise InputError("wrong-unit", said, fix=fix)
    for what, given in (("times", t), ("samples", values)):
        if given is None or isinstance(given, jax.Array):
            continue
        holds = "masked values" if np.ma.isMaskedArray(given) else np.asarray(given).dtype.name
        if np.ma.isMaskedArray(given) or np.asarray(given).dtype.kind not in "biuf":
            said = f"The {what} are not real numbers: they hold {holds}."
            raise InputError("not-numbers", said, fix="give floats, NaN where none is known.")
    if t is not None and np.shape(t) != np.shape(values)[:1]:
        said = f"There are times of shape {np.shape(t)} for samples of shape {np.shape(values)}."
        raise InputError("length-mismatch", said, fix="give one time for every sample.")


def complete(u: Any) -> None:
    """Raise `InputError` `not-finite` where an input is NaN or infinite."""
    if isinstance(u, Tracer) or not (bad := ~np.isfinite(np.asarray(u))).any():
        return
    said = f"{bad.sum()} inputs are NaN or infinite, the first at sample {np.argwhere(bad)[0, 0]}."
    fix = "fill them, or cut the record there: what follows depends on every input before it."
    raise InputError("not-finite", said, fix=fix)


def needed_time(name: str, time: Any, place: str = "") -> Any:
    """The time of a record; raise `InputError` where a model that depends on the rate is given none."""
    if time is None:
        said = f"{name} depends on the rate, and this record has no time."
        mend = "name the time column (--time COL) or the sampling step (--dt SECONDS)."
        raise InputError("no-time", said, place=place, fix=mend)
    return time


def check_clock(dt: np.ndarray, may_jump: bool = True) -> None:
    """Raise `InputError` `time-backwards` unless all steps are positive, or 0 where the input may jump."""
    if not ((dt > 0) | (may_jump & (dt == 0))).all():
        raise InputError(
            "time-backwards",
            "time does not increase from every sample to the next.",
            cause="rows written twice, or several runs in one sequence.",
            fix="drop repeated rows, and begin a sequence where a clock begins.",
        )


def one_column(u: Any) -> Any:
    """Inputs or prepared ones; raises `InputError` `wrong-shape` unless they are (samples,)."""
    if np.ndim(u) != 1:
        said = f"inputs of shape {np.shape(u)}."
        raise InputError(
            "wrong-shape", said, fix="give (samples,): of a table one column, u[:, 0]."
        )
    return u


def time_steps(
    t: Float[Array | np.ndarray, " samples"], t_before: Any, starts: Starts
) -> Float[Array | np.ndarray, " samples"]:
    """Time since the sample before; 0 where a sequence starts without a past (t_before NaN), or a clock
    begins anew.

    Of known times it is found by NumPy: no program is compiled for every number of rows. It is a NumPy
    array if the times are one.
    """
    xp, first, own = array_module(t, t_before), np.asarray(starts), isinstance(t, np.ndarray)
    t = xp.asarray(t)
    begin = t[first] - t_before
    begin = xp.where(begin > 0, begin, 0.0)
    dt = xp.diff(t, prepend=t[:1])
    if xp is np:
        check_clock(np.delete(dt, first))
        dt[first] = begin
        return dt if own else jnp.asarray(dt)
    return dt.at[first].set(begin)


@partial(jax.jit, static_argnames=("samples", "starts"))
def is_start(samples: int, starts: Starts) -> Float[Array, " samples"]:
    """1 where an independent sequence begins, else 0."""
    return jnp.zeros(samples).at[jnp.asarray(starts)].set(1)


class SteppedInput(NamedTuple):
    """Times or None, inputs, where sequences start, and the state they start in: None for the model's own,
    which may depend on its parameters."""

    t: Array | None
    u: Array
    start: Array
    state: Any


class AbstractSteppedModel(AbstractModel[State, SteppedInput]):
    """A model that is written as `init` and `step`; `prepare` and `evaluate` follow from them.

    The state that `init` returns is a pytree of floating arrays or numbers, and `step` returns one of the
    same shape. `evaluate` runs `step` in one compiled loop over the samples, and begins again in the
    prepared state wherever a sequence starts. Without times (`t=None`), `step` is called with None: a model
    that depends on the rate must raise `InputError` then.
    """

    def prepare(
        self, t: Times, u: Series, state: State | None = None, *, starts: Starts = (0,)
    ) -> SteppedInput:
        before: Any = jax.tree.map(jnp.asarray, self.init() if state is None else state)
        leaves = jax.tree.leaves(before)
        dtype = jnp.result_type(*leaves) if leaves else float
        u = jnp.asarray(u, dtype)
        if t is None:
            # Where the rate matters, a step without a time raises.
            jax.eval_shape(self.step, before, None, jnp.zeros(u.shape[1:]))
        else:
            t = jnp.asarray(t, dtype)
        return SteppedInput(t, u, is_start(len(u), starts) > 0, None if state is None else before)

    def evaluate(self, prepared: SteppedInput) -> Float[Array, " samples"]:
        own: Any = self.init() if prepared.state is None else prepared.state
        first = jax.tree.map(jnp.asarray, own)

        def sample(state: State, at: tuple[Any, Array, Array]) -> tuple[State, Array]:
            t, u, start = at
            return self.step(jax.tree.map(lambda a, b: jnp.where(start, a, b), first, state), t, u)

        return jax.lax.scan(sample, first, (prepared.t, prepared.u, prepared.start))[1]
