"""The Prony terms of a relaxing model."""

import numpy as np
from jaxtyping import Float

from hysteresis import AbstractModel, InputError
from hysteresis.models._viscoelastic import AbstractViscoelastic

Terms = Float[np.ndarray, " terms"]


def prony_of(model: AbstractModel) -> tuple[float, Terms, Terms]:
    """Long-term modulus, terms and times of a relaxation modulus. Raises `InputError` `not-exportable`."""
    if not isinstance(model, AbstractViscoelastic):
        raise InputError(
            "not-exportable",
            f"{type(model).__name__} has no relaxation modulus.",
            fix="Fit --step, --hold, --frequency, or --model GeneralizedMaxwell.",
        )
    if model.creeps and not float(model.chain().direct) > 0:
        raise InputError(
            "not-exportable",
            "The model has no spring, so its stiffness at once is infinite.",
            fix="Fit with a spring, or relaxation instead of creep.",
        )
    chain = model.driven_by_force(False)
    direct, rates, drives = (
        np.asarray(x) for x in (chain.direct, chain.all_rates, chain.all_drives)
    )
    there = (rates > 0) & (drives != 0)
    E, tau = -drives[there] / rates[there], 1 / rates[there]
    order = np.argsort(tau)
    return max(float(direct - E.sum()), 0.0), E[order], tau[order]
