"""Models beyond the inputs they were made for: a Preisach part goes on as play operators."""

from dataclasses import replace
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._errors import InputError
from .._law_model import once
from .._model import AbstractModel, Tree
from .._model import Series as Inputs
from .._parameter import KEPT, NOT_NEGATIVE, Scalar, Starts, Times, parameter
from .._precision import in_own_precision
from .._quantities import with_units
from .._registry import register
from ..preisach import GridDensity, Preisach
from ..preisach._memory import staircase
from ..trees import common_range, looked_for, part_tree, search_range
from ._compose import AbstractComposite, Over, Scaled, Series, Sum
from ._conditioned import Conditioned, _on_axis
from ._curves import AbstractCurve, Values

# A mixture of models that were found before: only its weights are left to find.
#
#     y(t) = offset + sum_k w_k model_k[u](t),  w_k > 0
#
# A specimen is a mixture of those of its kind: softer foams and stiffer ones, wider loops and narrower
# ones. The outputs of the models are computed once for a record, so fitting the weights is linear least
# squares.


@register
class Mixture(AbstractComposite[tuple[Any, ...], Float[Array, "samples models"]]):
    """Models of one input side by side, each times a weight: y = offset + sum_k w_k model_k[u].

    The models stay as they are: the weights and the offset are the parameters. It rises where they do.

    **Arguments:**

    - `models`: one or more, of the same input and output.
    - `weights`: one for each, above 0.
    - `offset`: in the output's unit.

    **Raises:** `InputError` `bad-parts` for anything but models, or other numbers of weights.

    **Example:**

        >>> soft, hard = hysteresis.LinearSponge(K=4.0, b=0.0), hysteresis.LinearSponge(K=2.0, b=0.0)
        >>> between = hysteresis.Mixture([soft, hard], weights=[0.5, 0.5])
        >>> between.simulate(None, np.array([0.0, 2.0])).tolist()
        [0.0, 6.0]
    """

    models: tuple[AbstractModel, ...] = eqx.field(converter=tuple, metadata={KEPT: True})
    weights: Values = parameter(unit="1", **NOT_NEGATIVE, meaning="weights of the models")
    offset: Scalar = parameter(0.0, unit="output", meaning="constant of the output")

    def __check_init__(self) -> None:
        _ = self.whole  # which checks the models
        if self.weights.shape != (len(self.models),):
            said = f"{self.weights.size} weights for {len(self.models)} models."
            raise InputError("bad-parts", said, fix="give one weight for each model.")

    @once
    def whole(self) -> Sum:
        """The same as a sum of scaled models."""
        count = len(self.models)
        shifts = [self.offset] + [0.0] * (count - 1)
        return Sum([Scaled(m, self.weights[k], shifts[k]) for k, m in enumerate(self.models)])

    def init(self, t0: Any = None, u0: Any = None) -> tuple[Any, ...]:
        return self.whole.init(t0, u0)

    def _over(self, run: Over, u: Any, state: Any) -> tuple[Any, Any]:
        return self.whole._over(run, u, state)

    def prepare(
        self, t: Times, u: Inputs, state: tuple[Any, ...] | None = None, *, starts: Starts = (0,)
    ) -> Float[Array, "samples models"]:
        states = (None,) * len(self.models) if state is None else state
        pairs = zip(self.models, states, strict=True)
        return jnp.stack([one.simulate(t, u, own, starts=starts) for one, own in pairs], axis=1)

    def evaluate(self, prepared: Float[Array, "samples models"]) -> Float[Array, " samples"]:
        return self.offset + prepared @ self.weights

    def laws(self, eps: float, depth: int) -> Tree:
        parts = [part_tree(part, eps, depth) for part in self.whole.parts]
        return parts[0] if len(parts) == 1 else looked_for(self, parts, eps)

    def search_range(self) -> tuple[Any, Any]:
        """What the ranges of the models have in common."""
        return common_range(map(search_range, self.models))


@in_own_precision
def extended(
    model: Any, low: float, high: float, conditions: tuple[float, float] | None = None
) -> Any:
    """The model with its grids of relays widened to hold inputs from `low` to `high`, and with `conditions`
    from one value to another.

    A Preisach model is saturated beyond its grid. Its widened grid has, in each cell beyond, the mass of
    the outermost cell at the same distance alpha - beta from the diagonal: a density of that distance
    alone is a sum of play operators (Prandtl-Ishlinskii). Until the input leaves the old range, the new
    relays stay where they begin, those above it down and those below it up, and an offset makes up
    for them: outputs in the old range are the same, and continuous where it ends. R goes on with its
    outermost slopes.

    A `Conditioned` has a further model at each of the two beyond its knots, M + s (M - M') of the knots
    next to it: outputs go on in a straight line.

    Parts of a `Sum`, a `Scaled`, a `Conditioned`, a `Mixture` and stages behind curves are widened in their
    places. Other models, and grids with a fitted first state, are given back as they are.

    **Example:**

        >>> wider = hysteresis.internal.extended(preisach, -5.0, 15.0)
        >>> bool(np.allclose(wider.simulate(t, u), preisach.simulate(t, u)))
        True
    """
    found = _extended(model, low, high, conditions)
    return found if found is model else with_units(found, model.units, model.trained)


def _extended(model: Any, low: float, high: float, ends: tuple[float, float] | None) -> Any:
    if isinstance(model, Sum):
        return Sum([extended(part, low, high) for part in model.parts])
    if isinstance(model, Conditioned | Mixture):
        wide = replace(model, models=tuple(extended(one, low, high) for one in model.models))
        return _going_on(wide, *ends) if ends and isinstance(wide, Conditioned) else wide
    if isinstance(model, Scaled):
        return replace(model, inner=extended(model.inner, low, high, ends))
    if isinstance(model, Series):
        return Series(_stages(model.parts, low, high))
    if isinstance(model, Preisach) and isinstance(model.density, GridDensity):
        outside = low < model.density.low or high > model.density.high
        return _widened(model, low, high) if outside and model.up is None else model
    return model


def _going_on(model: Conditioned, low: float, high: float) -> Conditioned:
    models, knots = [Sum([one]) for one in model.models], np.asarray(model.knots).tolist()
    for end in (high, low) if len(knots) > 1 else ():
        with np.errstate(divide="ignore", invalid="ignore"):  # 0 has no logarithm
            at = _on_axis(np.array([end, *knots[:-3:-1]]), model.axis, np)
            step = float((at[0] - at[1]) / (at[1] - at[2]))
        if 0 < step < np.inf:
            slope = Sum([models[-1], Scaled(models[-2], -1.0)])
            models.append(Sum([models[-1], Scaled(slope, step)]))
            knots.append(end)
        models, knots = models[::-1], knots[::-1]  # once more at the other end
    if len(models) == len(model.models):
        return model
    return replace(model, models=tuple(models), knots=np.array(knots))


def _stages(parts: tuple[Any, ...], low: float, high: float) -> list[AbstractModel]:
    """The stages up to the first with memory widened, those behind it as they are."""
    stages = []
    for k, part in enumerate(parts):
        stages.append(extended(part, low, high))
        if not isinstance(part, AbstractCurve):
            return [*stages, *parts[k + 1 :]]
        low, high = (float(end) for end in part.simulate(None, np.array([low, high])))
    return stages


def _widened(model: Preisach, low: float, high: float) -> Preisach:
    density: Any = model.density
    n, edges = density.cells, density.edges
    first, last = edges[1] - edges[0], edges[-1] - edges[-2]
    below = max(0, int(np.ceil((edges[0] - low) / first)))
    above = max(0, int(np.ceil((high - edges[-1]) / last)))
    lower = edges[0] - first * np.arange(below, 0, -1)
    nodes = np.concatenate([lower, edges, edges[-1] + last * np.arange(1, above + 1)])
    old = np.tril(np.asarray(density.weights))
    i, j = np.indices((below + n + above,) * 2) - below
    apart = np.clip(i - j, 0, n - 1)
    inside = (j >= 0) & (i < n)
    weights = np.where(
        inside,
        old[np.clip(i, 0, n - 1), np.clip(j, 0, n - 1)],
        np.where(i >= n, old[n - 1, n - 1 - apart], old[apart, 0]),
    )
    weights[(i < j) | (i - j >= n)] = 0.0
    begin_down, begin_up = weights[i >= n].sum(), weights[j < 0].sum()
    offset = np.asarray(model.offset) + model.orientation * (begin_down - begin_up)
    reversible = None
    if model.reversible is not None:
        increments = np.asarray(model.reversible)
        reversible = np.pad(increments, (below, above), "edge")
        offset = offset - below * increments[0]
    start = staircase(model.initial, density.low, density.high, model.capacity // 2)
    return replace(
        model,
        density=replace(density, low=nodes[0], high=nodes[-1], weights=weights, nodes=tuple(nodes)),
        reversible=reversible,
        offset=offset,
        initial=(float(nodes[-1]), density.low, *start),
    )
