"""`invert`: the inverse of a fitted model, or of many draws of one."""

from typing import Any

import equinox as eqx
from numpy.typing import ArrayLike

from hysteresis import AbstractModel, InputError, parameters
from hysteresis._quantities import with_units

from ._contract import AbstractCompensator
from .guards._guarded import GuardedCompensator, within_of
from .guards._rising import require_rising
from .guards._run_in import Past, Start, starts_of
from .inverses import inverse_of
from .uncertainty._ensemble import EnsembleCompensator


def invert(
    model: AbstractModel,
    *,
    trained: tuple[float, float] | None = None,
    beyond: str = "limit",
    start: str = "known",
    longest: float | None = None,
    past: tuple[ArrayLike | None, ArrayLike] | None = None,
    deviation: float = 0.0,
    seen: tuple[float, float] | None = None,
) -> AbstractCompensator:
    """The exact inverse of a fitted model, as a compensator, with a guard where `trained` is given.

    **Arguments:**

    - `model`: of many models, such as `Posterior.model`, an `EnsembleCompensator` is made, which tells how
      far their estimates lie apart.
    - `trained`: (low, high), the least and the greatest input of the training rows, in the input's unit.
      None: no guard; then estimates beyond are as far out as the model continues.

    **Other arguments:** see `GuardedCompensator`.

    - `beyond`: what becomes of estimates beyond `trained`: "limit" (held at the nearer end), "nan", or
      "free" (as they are). Their status is EXTRAPOLATED.
    - `start`: "known": the first sample follows the model's virgin state. "unknown": the status is
      RUN_IN until the readings have replaced what is unknown, see `GuardedCompensator`.
    - `past`: (times, inputs) of the training rows, which bound what an unknown start can be, and lead
      through the states in which the output has to rise with the input. A model without rates needs none,
      or no times.
    - `deviation`: of usual estimates, in the input's unit; 0 where none is stated.
    - `seen`: the least and the greatest reading of the training rows.
    - `longest`: with `trained`, the longest time between two readings; a longer one is taken for it.

    **Returns:** a compensator, with the units of the model where it has any.

    **Raises:** `InputError` where the model has no inverse (a decreasing stage, a signed density, no
    slope, an output that falls in a state of the `past`), and `bad-option` or `zero-range` for options that
    do not fit.

    **Example:**

        >>> y = model.simulate(t, u)
        >>> compensate.invert(model).simulate(t, y).value.round(6).tolist() == u.tolist()
        True
        >>> float(compensate.invert(model, trained=(0.0, 4.0)).simulate(t, y).value.max())
        4.0
    """
    if not isinstance(model, eqx.Module):
        raise InputError(
            "not-invertible", f"{model!r} is neither a model nor a fit.",
            fix="give a model with its parameters, or hysid.invert a fit: identify.load(DIR).",
        )  # fmt: skip
    if start not in ("known", "unknown"):
        raise InputError(
            "bad-option", f"start={start!r} is unknown.", fix='give "known" or "unknown".'
        )
    inverse: Any
    if min((value.ndim for _, _, value in parameters(model) if value is not None), default=0):
        inverse = EnsembleCompensator(model)
    else:
        inverse = inverse_of(model)
    units = model.units and model.units.reversed
    if trained is None:
        if start == "unknown":
            raise InputError(
                "bad-option",
                "an unknown start needs the trained range, over which the memory is replaced.",
                fix="give trained=(low, high), the inputs of the training rows.",
            )
        return inverse if units is None else with_units(inverse, units)
    low, high = trained
    history = None if past is None else Past(*past)
    if history is not None:
        require_rising(inverse, model, low, high, history)
    others: tuple[Start, ...] = ()
    if start == "unknown":
        others = starts_of(
            inverse, model, low, high, history, float(within_of(deviation, low, high))
        )
    guarded = GuardedCompensator(
        inverse, low, high, beyond, others, deviation, seen, longest=longest
    )
    return guarded if units is None else with_units(guarded, units)
