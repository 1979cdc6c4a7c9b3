"""A mixture of models that were found before: only its weights are left to find.

    y(t) = offset + sum_k w_k model_k[u](t),  w_k > 0

A specimen is a mixture of those of its kind: softer foams and stiffer ones, wider loops and narrower ones.
The outputs of the models are computed once for a record, so fitting the weights is linear least squares.
"""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._errors import InputError
from .._model import AbstractModel, Tree
from .._model import Series as Inputs
from .._once import once
from .._parameter import KEPT, NOT_NEGATIVE, Scalar, parameter
from .._registry import register
from .._type_variables import Starts, Times
from ..trees import common_range, looked_for, part_tree, search_range
from ._compose import AbstractComposite, Over, Scaled, Sum
from ._curves import Values


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
