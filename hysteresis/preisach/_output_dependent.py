"""The product Preisach model: the weight of the relays depends on the output."""

from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._errors import InputError
from .._model import AbstractModel, Series, Tree
from .._parameter import Scalar, array_module, is_concrete, parameter
from .._registry import register
from ..trees import polygon, series
from ._everett import read
from ._preisach import Preisach, PreisachInput, PreisachState
from ._saturation import saturated_outputs


@register
class OutputDependentPreisach(AbstractModel[PreisachState, PreisachInput]):
    """Kadar's product model: dy = K(y) dP, relays whose weight depends on the output.

        y = g(P[u]),     g(P in negative saturation) = offset,     g' = K >= 0

    g is piecewise linear over n equal cells of the range of P, and continues straight beyond it. Loops
    are wiped out as in P. Minor loops between the same inputs are not congruent, because their height is
    proportional to g' at their place. Scaling or shifting P alone does not change y.

    **Arguments:**

    - `inner`: P.
    - `increments`: (n,) increments of g over its cells, none negative.
    - `offset`: y in negative saturation.

    Raises `InputError` where the increments are not one-dimensional, or negative.

    Source: Kadar 1987, On the Preisach function of ferromagnetic hysteresis.

    **Example:**

        >>> product = hysteresis.OutputDependentPreisach(preisach, increments=np.array([1.0, 3.0]))
        >>> np.asarray(product.simulate(None, np.array([0.0, 6.0, 10.0, 6.0]))).round(2).tolist()
        [0.0, 0.78, 4.0, 2.87]
    """

    inner: Preisach
    increments: Float[Array, " cells"] | np.ndarray = parameter(
        unit="output", bounds=(0.0, float("inf")), meaning="increments over the range of the relays"
    )
    offset: Scalar = parameter(0.0, unit="output", meaning="output in negative saturation")

    def __check_init__(self) -> None:
        if self.increments.ndim != 1 or not len(self.increments):
            raise InputError(
                "wrong-shape",
                f"the increments have shape {self.increments.shape}.",
                fix="give a row of them, one for each cell of the inner model's range.",
            )
        if is_concrete(self.increments) and not bool((self.increments >= 0).all()):
            raise InputError(
                "output-falls",
                f"the increments reach down to {self.increments.min():.4g}.",
                fix="keep them from 0 up: the output has to rise with the relays'.",
            )

    def init(self, t0: Any = None, u0: Any = None) -> PreisachState:
        return self.inner.init(t0, u0)

    def step(self, state: PreisachState, t: Any, u: Any) -> tuple[PreisachState, Float[Array, ""]]:
        state, y = self.inner.step(state, t, u)
        return state, self.rescale(y)

    def prepare(
        self,
        t: Series | None,
        u: Series,
        state: PreisachState | None = None,
        *,
        starts: tuple[int, ...] = (0,),
    ) -> PreisachInput:
        return self.inner.prepare(t, u, state, starts=starts)

    def evaluate(self, prepared: PreisachInput) -> Float[Array, " samples"]:
        return self.rescale(self.inner.evaluate(prepared))

    def laws(self, eps: float, depth: int) -> Tree:
        """Its relays, then its polygon."""
        ends = saturated_outputs(self.inner)
        xp = array_module(*ends)
        nodes = jnp.asarray(xp.linspace(*map(xp.asarray, ends), len(self.increments) + 1))
        bent = polygon(nodes, jnp.asarray(self.increments), self.offset, eps)
        return series(self.inner.tree(eps, depth), bent)

    def rescale(self, inner_output: Float[Array, "*samples"]) -> Float[Array, "*samples"]:
        """g, by element."""
        low, high = saturated_outputs(self.inner)
        increment, begin = self._cells()
        position = (inner_output - low) * (len(begin) / (high - low))
        cell = jnp.clip(jnp.floor(position), 0, len(begin) - 1)
        index = cell.astype(jnp.int32)
        return self.offset + read(begin, index) + (position - cell) * read(increment, index)

    def unscale(self, y: Float[Array, "*samples"]) -> Float[Array, "*samples"]:
        """The inverse of g, by element, where every increment is positive."""
        low, high = saturated_outputs(self.inner)
        increment, begin = self._cells()
        above = y - self.offset
        index = jnp.clip(jnp.searchsorted(begin, above, side="right") - 1, 0, len(begin) - 1)
        within = (above - read(begin, index)) / read(increment, index)
        return low + (index.astype(y.dtype) + within) * ((high - low) / len(begin))

    def _cells(self) -> tuple[Array, Array]:
        """Increments, and g where each begins, without the offset."""
        increment = jnp.asarray(self.increments)
        return increment, jnp.cumsum(increment) - increment
