"""The contract that every compensator keeps."""

import abc
from collections.abc import Callable
from importlib import import_module
from typing import TYPE_CHECKING, Any, ClassVar, Generic, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float, Int
from numpy.typing import ArrayLike

from hysteresis._drawing import html_of, plot_of
from hysteresis._model import same_samples
from hysteresis._parameter import PyTree, State, as_array, as_float
from hysteresis._precision import PickledAsItIs, in_own_precision, keep_precision
from hysteresis._quantities import Units, as_units
from hysteresis._show import one_line, table

from .runtime._status import Status as Status


class Estimate(NamedTuple):
    """The input a compensator finds behind an output, and the `Status` of each value."""

    value: Float[Array, "*samples"]
    status: Int[Array, "*samples"]


# As in `hysteresis._parameter`: checkers see a default, so that the bare class is a whole type.
if TYPE_CHECKING:
    from typing_extensions import TypeVar

    Found = TypeVar("Found", default=Any)
else:
    from typing import TypeVar

    Found = TypeVar("Found")


class AbstractStreamed(PickledAsItIs, eqx.Module, Generic[State, Found]):
    """Readings in, findings out, with a memory: a step is a series of one reading."""

    along: ClassVar[int] = -1
    """Axis of the samples in what is found."""

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        keep_precision(cls, ("init", "stream"))

    @abc.abstractmethod
    def init(self) -> State:
        """The state before the first reading: that of a compensator belongs to the model's virgin state."""

    @abc.abstractmethod
    def stream(self, t: ArrayLike | None, y: ArrayLike, state: State) -> tuple[State, Found]:
        """All samples at once: the state after them, and the estimates."""

    @in_own_precision
    def step(self, state: State, t: ArrayLike | None, y: ArrayLike) -> tuple[State, Found]:
        """One output in, one estimate of the input out."""
        times = None if t is None else jnp.asarray(t, float)[None]
        state, found = self.stream(times, jnp.asarray(y, float)[None], state)
        return state, jax.tree.map(lambda x: jnp.take(x, 0, self.along), found)

    @in_own_precision
    def simulate(self, t: ArrayLike | None, y: ArrayLike, state: State | None = None) -> Found:
        """`step` over all samples: arrays of the shape of `y`; `t` may be None without rates."""
        same_samples(t, y)
        return self.stream(t, as_float(y), self.init() if state is None else state)[1]


class AbstractCompensator(AbstractStreamed[State, Found]):
    """A model run backwards, sample by sample, with the model's own memory. The law it keeps:

        model.simulate(t, compensator.simulate(t, y).value) == y     on the reachable set

    to 1e-9 of the range of y. Elsewhere the status says why not. A compensator never raises inside a loop.

    **Field** of every compensator, given by name: `units`, from readings to estimates, where they are
    known; `invert` takes them from the model.
    """

    units: Units | None = eqx.field(default=None, static=True, kw_only=True, converter=as_units)

    def state_from(self, t: ArrayLike | None, u: ArrayLike, y: ArrayLike) -> State:
        """The state after some rows of which both input and output are known, such as a touch with a known
        force: as `AbstractModel.state_from`.

        A guard whose start is unknown compares from there on with the other pasts that the rows leave open,
        and says `OK` where these agree.

        **Arguments:** times, or None, inputs and outputs (rows,); a model that depends on a condition needs
        (rows, 2) inputs beside it.

        **Raises:** `InputError` `not-a-model` where no model is inside, and as that of the model.

        **Example:**

            >>> compensator = compensate.invert(model)
            >>> state = compensator.state_from(t[3:9], u[3:9], model.simulate(t, u)[3:9])
            >>> found = compensator.simulate(t[9:], model.simulate(t, u)[9:], state)
            >>> bool(np.allclose(found.value, u[9:]))
            True
        """
        # By name, because it is built on this contract.
        return import_module("compensate.guards._guarded").warmed(self, t, u, y)

    def plot(self) -> Any:
        """Estimates while the reading goes up, down and half way up again, as a matplotlib `Figure`.

        Samples whose status is not OK are grey.

        **Returns:** a `matplotlib.figure.Figure`, which a notebook shows and `savefig` writes.

        **Raises:** `InputError` `missing-extra` where matplotlib or hysid cannot be imported.

        **Example:**

            >>> compensator.plot().axes[0].get_xlabel()
            'reading'
        """
        return plot_of(self)

    def __str__(self) -> str:
        return table(self)

    def __repr__(self) -> str:
        return one_line(self)

    def _repr_html_(self) -> str | None:
        return html_of(self)


def scanned(one: Any, t: ArrayLike | None, y: Array, state: PyTree) -> tuple[PyTree, PyTree]:
    """`one.take(state, t, y)` sample by sample: state, estimates."""
    t = jnp.zeros(y.shape[:1], y.dtype) if t is None else jnp.asarray(t, y.dtype)
    return in_few_lengths(_scan, one, state, t, y)


@eqx.filter_jit
def _scan(one: Any, state: PyTree, t: Array, y: Array) -> tuple[PyTree, PyTree]:
    return jax.lax.scan(lambda carry, sample: one.take(carry, *sample), state, (t, y))


def in_few_lengths(
    run: Callable[..., tuple[PyTree, PyTree]], one: Any, state: PyTree, t: Any, *rows: Any, along: int = 0
) -> tuple[PyTree, PyTree]:  # fmt: skip
    """`run(one, state, t, *rows)`, a program of JAX that gives a state and what is found of all rows.

    Compiling it takes seconds for each length. So rows are lengthened to a power of two by some that are no
    readings, NaN or False, which change nothing. `along`: the axis of rows in what is found.
    """
    is_traced = any(isinstance(x, Tracer) for x in jax.tree.leaves((one, state, t, rows)))
    if is_traced or not (count := len(rows[0])):
        return run(one, state, t, *rows)
    more = (1 << (count - 1).bit_length()) - count

    def longer(x: Any) -> Array:
        around = (0, more), *[(0, 0)] * (np.ndim(x) - 1)
        none = np.nan if jnp.issubdtype(x.dtype, jnp.floating) else 0
        return as_array(np.pad(x, around, constant_values=none))

    t = None if t is None else as_array(np.pad(t, (0, more), mode="edge"))
    state, found = run(one, state, t, *jax.tree.map(longer, rows))
    shorter = slice(count) if along == 0 else (..., slice(count))
    return state, jax.tree.map(lambda x: as_array(np.asarray(x)[shorter]), found)
