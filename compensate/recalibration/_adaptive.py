"""A compensator that recalibrates itself from inputs that are known at times."""

from enum import IntEnum
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from numpy.typing import ArrayLike

from hysteresis import AbstractModel, InputError, register
from hysteresis._model import DOUBLE
from hysteresis._parameter import array_module, as_array
from hysteresis.running import Known, Numbers, numbers_of, place_of
from hysteresis.trees import ROUNDING, Tree, flat_width, node, part_tree, plain, precisions

from .._contract import AbstractCompensator
from ..inverses._law import OWN, LawState, first_state, told_from

SAID = 6
"""Numbers that the law says beside an estimate, see `Recalibrated`."""


class Advice(IntEnum):
    """Why a calibration is needed now."""

    NONE = 0
    ZERO = 1
    """Something changed and is being learnt: most of it is the zero."""
    GAIN = 2
    """Most of it is the rise of the output."""
    LOOP = 3
    """Most of it is the width of the loop."""
    SHAPE = 4
    """Errors are large, and neither zero, gain nor width explains them: measure and fit again."""
    STALE = 5
    """The zero may have drifted too far since the last reference: give one."""


class Recalibrated(NamedTuple):
    """Estimates, and at each sample the advice, the accuracy lost and what has been learnt.

    - `value`, `status`: as of `Estimate`, made before a reference was looked at.
    - `advice`: an `Advice`; `lost`: rms error beyond that of the fit, in the input's unit; `changes`: found
      so far; `zero` (in the output's unit), `gain` and `loop`: learnt so far, the latter two over the
      fit's.
    """

    value: Float[Array, "*samples"]
    status: Int[Array, "*samples"]
    advice: Int[Array, "*samples"]
    lost: Float[Array, "*samples"]
    changes: Int[Array, "*samples"]
    zero: Float[Array, "*samples"]
    gain: Float[Array, "*samples"]
    loop: Float[Array, "*samples"]


@register
class AdaptiveCompensator(AbstractCompensator[LawState, Recalibrated]):
    """A compensator that recalibrates itself, from occasional inputs that are known.

    The model is a sum of parts, each of which rises with the input,

        sign y = zero + drift t + sum_k w_k part_k[u],     w_k >= least_k > 0,

    and the estimate is the input behind the reading: of `fitted`, the compensator of the fit, until
    references have proved something else, then by bisection of that sum. A sample with a `reference`, the
    true input, is one row of a recursive least-squares fit of zero, drift and weights: what is older is
    forgotten only along that row (Kulhavy), so that nothing is forgotten which the references do not say
    anew. A weight that would fall below its least one is held there, so that the inverse exists after every
    update. Each part has two memories. One follows the estimates, and the estimates come from it. The other
    one follows the references, and between them the estimates; what is learnt comes from it. They do not
    depend on the weights, so no update is felt as a jump of the input.

    Page's test watches the errors of the predicted readings: a sum of log-likelihood ratios of errors twice
    as large. If those were normal, and independent after `correlation` samples, it would alarm by chance
    once in exp(`threshold`) independent references, or less often. An alarm opens the covariance, and the
    next references are learnt fast.

    What is learnt is used only as far as it has proved better: what was known before a run of references
    predicts that run. With e the errors of the fit there and d what was learnt less the fit, the share

        2 (sum(d e) / sum(d^2) - 3 sqrt(noise / sum(d^2))),    between 0 and 1,

    of the way from the fit to what was learnt is gone: all of it where what was learnt is surely nearer to
    the readings, none where the share is below 0. So a sensor that has not changed is not made worse by
    what a few references happen to say, and a change is used from the second run of references on.

    `adaptive` makes one from a model and a record.
    """

    fitted: AbstractModel
    parts: tuple[AbstractModel, ...]
    low: float = eqx.field(static=True)
    high: float = eqx.field(static=True)
    settings: Tree
    start: Float[Array, " unknowns"]
    numbers: Float[Array, " numbers"]
    known: Known = eqx.field(static=True)

    def __init__(
        self,
        fitted: AbstractModel,
        parts: tuple[AbstractModel, ...],
        ends: tuple[float, float],
        settings: Tree,
        start: Float[Array, " unknowns"],
    ):
        """`settings`: parameters of `hysteresis/laws/adaptive.py`, what the ends tell left out; `start`:
        the variances of zero, drift and weights at first."""
        self.fitted, self.parts, self.settings, self.start = fitted, parts, settings, start
        self.low, self.high = ends
        self.known, m = numbers_of(self.tree(plain(fitted.tree(depth=OWN)), depth=OWN))
        self.numbers = jnp.asarray(m, float)

    def init(self) -> LawState:
        return first_state(Numbers(self.known, self.numbers), jnp.asarray(self.low, float))

    def restarted(self, state: LawState) -> LawState:
        """The first state with what has been learnt: where another log begins.

        **Example:**

            >>> own = compensate.adaptive(fit.model, record)
            >>> state, _ = own.follow(record.time, record.output, record.input)
            >>> own.unknowns(own.restarted(state)).tolist() == own.unknowns(state).tolist()
            True
        """
        first, begin = self.init(), self._place("share")
        return first._replace(
            numbers=jnp.concatenate([first.numbers[:begin], state.numbers[begin:]])
        )

    def unknowns(self, state: LawState) -> Float[Array, " unknowns"]:
        """Zero, drift (per time) and the weights of the parts, as learnt at the last reference.

        **Example:**

            >>> own = compensate.adaptive(fit.model, record)
            >>> own.unknowns(own.init()).shape
            (3,)
        """
        begin = self._place("theta")
        return state.numbers[begin : begin + len(self.parts) + 2]

    def follow(
        self,
        t: ArrayLike | None,
        y: ArrayLike,
        references: ArrayLike | None = None,
        state: LawState | None = None,
    ) -> tuple[LawState, Recalibrated]:
        """As `simulate` with true inputs (samples,), NaN where they are not known, and with the state after
        it, from which another log goes on.

        **Example:**

            >>> own = compensate.adaptive(fit.model, record)
            >>> state, _ = own.follow(record.time, record.output, record.input)
            >>> own.unknowns(state).shape
            (3,)
        """
        y = jnp.asarray(y, float)
        u = jnp.full_like(y, jnp.nan) if references is None else jnp.asarray(references, float)
        if u.shape != y.shape:
            raise InputError(
                "length-mismatch", f"{len(u)} references for {len(y)} readings.",
                fix="give one for each reading, NaN where it is not known.",
            )  # fmt: skip
        return self.stream(t, jnp.stack([y, u], 1), self.init() if state is None else state)

    def stream(
        self, t: ArrayLike | None, y: ArrayLike, state: LawState
    ) -> tuple[LawState, Recalibrated]:
        """Readings (samples,), or with references (samples, 2): the state after them, and the estimates."""
        xp = array_module(t, y)
        pairs: Any = xp.asarray(y, float)
        if pairs.ndim == 1:
            pairs = xp.stack([pairs, xp.full_like(pairs, xp.nan)], 1)
        after, found = told_from(state, Numbers(self.known, self.numbers), t, pairs, width=SAID)
        advice, lost, changes, zero, gain, loop = found.said.T
        said = advice.astype(int), lost, changes.astype(int), zero, gain, loop
        return after, Recalibrated(*map(as_array, (found.value, found.status, *said)))

    def _place(self, field: str) -> int:
        """Where in the state a number of the law begins."""
        return place_of(self.known, field) - len(self.numbers) + self.known.states

    def tree(self, fitted: Tree, eps: float = DOUBLE, depth: int = 64) -> Tree:
        """The laws as they begin. `fitted`: those of the model, which may be of another precision or depth.

        **Example:**

            >>> own = compensate.adaptive(fit.model, record)
            >>> own.tree(fit.model.tree())["kind"]
            'adaptive'
        """
        own, n = self.settings, len(self.parts) + 2
        parts = [part_tree(part, eps, depth) for part in self.parts]
        theta = np.concatenate([[own["zero"], 0.0], own["nominal"]])
        reach = self.high - self.low
        made = node(
            "adaptive",
            {
                "low": self.low, "high": self.high, "rounding": ROUNDING * eps,
                "flat": flat_width(eps) * reach, **precisions(eps, reach),
                "parts": len(self.parts), **own,
            },
            {
                "value": self.low, "slope": 0.0, "reference": 0.0, "known": 0, "share": 0.0, "elapsed": 0.0,
                "idle": 0.0, "used": theta, "theta": theta, "covariance": np.diag(self.start),
                "before": theta, "run": 0.0, "common": 0.0, "apart": 0.0,
                "evidence": 0.0, "excess": 0.0, "gained": 0.0,
                "possible": 0.0, "settled": 0.0, "loss": own["error"] ** 2, "residual": 1.0, "changes": 0,
                "output": np.zeros(n), "shown": np.zeros(n), "along": np.zeros(n), "work": np.zeros(n * n),
            },
            [*parts, fitted],
        )  # fmt: skip
        return plain(made)
