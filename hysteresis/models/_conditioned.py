"""A model whose output also depends on a condition, such as a temperature or a pressure."""

from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._errors import InputError
from .._escape import shell_word
from .._model import AbstractModel, Series, Tree
from .._parameter import (
    Starts,
    Times,
    array_module,
    check_increasing,
    check_shapes,
    is_concrete,
    parameter,
)
from .._registry import register
from ..numerics._functions import hats
from ..records._record import Record
from ..trees import common_range, input_range, looked_for, node, reach_of
from ._compose import AbstractComposite, Over, Scaled, Sum
from ._compose import Series as Chain
from ._curves import Values

AXES = ("linear", "logarithmic", "reciprocal")
"""On which axes of the condition the output may be interpolated."""


class ConditionedInput(NamedTuple):
    """The prepared input of every model, and the share of each model at every sample."""

    models: tuple[Any, ...]
    shares: Float[Array, "samples knots"]


@register
class Conditioned(AbstractComposite[tuple[Any, ...], ConditionedInput]):
    """A model for each of a few values of a condition c, and between them the interpolation:

        y = h_1(c) M_1[u] + ... + h_K(c) M_K[u]

    All M_k are driven by the same input u and keep their own states. h_k are the hat functions of the
    knots c_1 < ... < c_K: their sum is 1, and h_k(c_k) = 1. So y is M_k[u] at c = c_k, straight in c
    between two knots, and that of the nearer knot beyond the first and the last. The condition may be
    constant in a record or change with time; it drives no memory. Where every M_k rises with u, so does
    y, whatever c is.

    It takes two inputs: u and c are the columns of an array (samples, 2) in `simulate`, and `step` takes
    the pair (u, c).

    **Arguments:**

    - `models`: M_1 ... M_K, one for each knot, of one type.
    - `knots`: (K,) values of the condition, increasing, in `unit`.
    - `condition`, `unit`: name and unit of the condition.
    - `axis`: "linear", or "logarithmic" or "reciprocal" to interpolate over log(c) or 1 / c, for knots
      above 0. A reciprocal absolute temperature is the axis of thermally activated processes.

    **Raises:** `InputError` `bad-parts`, `length-mismatch`, `parameter-out-of-bounds`, `bad-option`.

    **Example:**

        >>> cold, warm = (hysteresis.LinearSponge(K=K, b=0.0) for K in (1.0, 2.0))
        >>> sponge = hysteresis.Conditioned((cold, warm), [10.0, 30.0], "temperature", "degC")
        >>> sponge.simulate(None, np.array([[4.0, 10.0], [4.0, 20.0], [4.0, 50.0]])).tolist()
        [4.0, 6.0, 8.0]
    """

    models: tuple[AbstractModel, ...] = eqx.field(converter=tuple)
    knots: Values = parameter(unit="condition", fixed=True, meaning="condition of each model")
    condition: str = eqx.field(default="condition", static=True)
    unit: str = eqx.field(default="1", static=True)
    axis: str = eqx.field(default="linear", static=True)

    def __check_init__(self) -> None:
        kinds = {type(model) for model in self.models}
        if len(kinds) != 1 or not issubclass(min(kinds, key=str), AbstractModel):
            said = f"{len(self.models)} parts of {len(kinds)} types."
            raise InputError("bad-parts", said, fix="give one model or more, all of one type.")
        if self.axis not in AXES:
            raise InputError("bad-option", f"axis={self.axis!r}.", fix=f"one of {', '.join(AXES)}.")
        check_shapes(knots=(self.knots, f"{len(self.models)}"))
        check_increasing("knots", self.knots)
        if self.axis != "linear" and is_concrete(self.knots) and not np.all(self.knots > 0):
            mend = f"the {self.axis} axis needs them above 0."
            raise InputError("parameter-out-of-bounds", f"knots = {self.knots}.", fix=mend)

    def shares(self, c: Float[Array, "*samples"] | Any) -> Float[Array, "*samples knots"]:
        """h_1(c) ... h_K(c), see the class."""
        return _hat_functions(jnp.asarray(c, float), self.knots, self.axis)

    def init(self, t0: Any = None, u0: Any = None) -> tuple[Any, ...]:
        first = None if u0 is None else jnp.asarray(u0)[0]
        return tuple(model.init(t0, first) for model in self.models)

    def _over(self, run: Over, u: Any, state: Any) -> tuple[Any, Any]:
        u, c = _columns(u, self.condition)
        pairs = zip(self.models, state or (None,) * len(self.models), strict=True)
        found = [run(model, u, own) for model, own in pairs]
        y = (jnp.stack([each for _, each in found], -1) * self.shares(c)).sum(-1)
        return tuple(own for own, _ in found), y

    def prepare(
        self, t: Times, u: Series, state: tuple[Any, ...] | None = None, *, starts: Starts = (0,)
    ) -> ConditionedInput:
        """See `AbstractModel.prepare`; `u`: (samples, 2), the input and the condition.

        Raises `InputError` `wrong-shape` for another shape.
        """
        u, c = _columns(u, self.condition)
        states = (None,) * len(self.models) if state is None else state
        pairs = zip(self.models, states, strict=True)
        prepared = tuple(model.prepare(t, u, own, starts=starts) for model, own in pairs)
        return ConditionedInput(prepared, self.shares(c))

    def evaluate(self, prepared: ConditionedInput) -> Float[Array, " samples"]:
        pairs = zip(self.models, prepared.models, strict=True)
        outputs = jnp.stack([model.evaluate(own) for model, own in pairs], 1)
        return (outputs * prepared.shares).sum(1)

    def laws(self, eps: float, depth: int) -> Tree:
        """A sum of shares, which is looked for as a whole; turned where the models fall."""
        xp = array_module(self.knots)
        knots = xp.asarray(self.knots)
        at = _on_axis(knots, self.axis, xp)
        around = jnp.asarray(xp.concatenate([at[:1] - 1, at, at[-1:] + 1]))
        factors = [x for one in self.models if (x := last_factor(one)) is not None]
        sign = {"factor": jnp.where(factors[0] < 0, -1.0, 1.0), "offset": 0.0} if factors else None
        ends, parts = (
            {"axis": AXES.index(self.axis), "low": self.knots[0], "high": self.knots[-1]},
            [],
        )
        for k, one in enumerate(self.models):
            own = {"before": around[k], "at": around[k + 1], "after": around[k + 2]}
            inner = one.tree(eps, depth)
            inner = node("scaled", sign, parts=[inner]) if sign else inner
            parts.append(node("share", ends | own, {"share": 0.0}, [inner]))
        whole = looked_for(self, parts, eps, alone=self.models)
        return node("scaled", sign, parts=[whole]) if sign else whole

    def search_range(self) -> tuple[Any, Any]:
        """What the ranges of all models have in common, else as far as their parameters reach."""
        if ends := [found for one in self.models if (found := _range_of(one)) is not None]:
            return common_range(ends)
        return reach_of(*self.models)


def _columns(u: Any, condition: str) -> tuple[Any, Any]:
    """Input and condition of a sample or of a record."""
    u = u if isinstance(u, np.ndarray) else jnp.asarray(u)
    if np.shape(u)[-1:] != (2,):
        said = f"inputs of shape {np.shape(u)} for a model of an input and {condition!r}."
        mend = "give both as the columns of an array (samples, 2)."
        raise InputError("wrong-shape", said, fix=mend)
    return u[..., 0], u[..., 1]


def last_factor(model: AbstractModel) -> Any:
    """The factor of a model that is scaled at last; None of others."""
    if isinstance(model, Chain):
        return last_factor(model.parts[-1])
    return model.factor if isinstance(model, Scaled) else None


def _range_of(model: AbstractModel) -> tuple[Any, Any] | None:
    """The inputs that a model was made for, as far as its parts say."""
    if isinstance(model, Scaled):
        return _range_of(model.inner)
    if isinstance(model, Chain):
        return _range_of(model.parts[0])
    if isinstance(model, Sum):
        found = [ends for part in model.parts if (ends := _range_of(part)) is not None]
        return common_range(found) if found else None
    return input_range(model)


# Not compiled, each of its operations is compiled by itself for every length: 0.7 s.
@partial(jax.jit, static_argnames="axis")
def _hat_functions(c: Array, knots: Array, axis: str) -> Float[Array, "*samples knots"]:
    """The hat functions of the knots on an axis, beyond the knots those of their ends."""
    return hats(*(_on_axis(jnp.clip(x, knots[0], knots[-1]), axis) for x in (c, knots)))


def _on_axis(c: Any, axis: str, xp: Any = jnp) -> Any:
    if axis == "logarithmic":
        return xp.log(c)
    return -1 / c if axis == "reciprocal" else c


def condition_of(model: Any) -> Conditioned | None:
    """The part of a model that takes a condition beside the input; None where there is none."""
    if isinstance(model, Conditioned):
        return model
    if isinstance(model, Scaled):
        return condition_of(model.inner)
    return condition_of(model.parts[0]) if isinstance(model, Chain) else None


def condition_column(record: Record, name: str) -> np.ndarray:
    """The values of a condition at every row of a record.

    Raises `InputError` `no-condition` where the record does not have it.
    """
    if name not in record.columns:
        said = f"the model depends on {name!r}, and the record has no such column."
        mend = f"name it: --condition {shell_word(name)}, or condition={name!r}."
        raise InputError("no-condition", said, place=record.source, fix=mend)
    return np.asarray(record.columns[name], float)


def with_condition(model: Any, record: Record, x: Any) -> Any:
    """Inputs or outputs at the rows of a record, as a model or its inverse takes them.

    **Arguments:** `x`: (samples,), such as `record.input` for the model or `record.output` for the inverse.

    **Returns:** `x` itself; for a model that depends on a condition an array (samples, 2), x and c.

    **Raises:** `InputError` `no-condition` where the record lacks the condition.
    """
    found = condition_of(model)
    if found is None:
        return x
    return np.column_stack([x, condition_column(record, found.condition)])
