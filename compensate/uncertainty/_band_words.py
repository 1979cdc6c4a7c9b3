"""A calibrated band as plain data, and back: what a fit's folder holds of it."""

from collections.abc import Mapping
from typing import Any

import jax.numpy as jnp
import numpy as np

from .._contract import AbstractCompensator
from ._calibrated import CalibratedCompensator
from ._motion import Motions

ARRAYS = ("levels", "error", "scores")
NUMBERS = ("width", "coverage", "coverage_before", "share", "lasts")


def in_words(band: CalibratedCompensator) -> dict[str, Any]:
    """All but the inner compensator, for JSON."""
    found: dict[str, Any] = {name: np.asarray(getattr(band, name)).tolist() for name in ARRAYS}
    for name in NUMBERS:
        value = float(getattr(band, name))
        found[name] = value if np.isfinite(value) else None
    motions = band.motions and {
        k: np.asarray(v).tolist() for k, v in band.motions._asdict().items()
    }
    return found | {"motions": motions}


def of_words(words: Mapping[str, Any], inner: AbstractCompensator) -> CalibratedCompensator:
    """The inverse of `in_words`, around a compensator."""
    found: dict[str, Any] = {name: jnp.asarray(words[name], float) for name in ARRAYS}
    for name in NUMBERS:
        found[name] = np.nan if words[name] is None else float(words[name])
    known = words["motions"]
    motions = known and Motions(*(jnp.asarray(known[name], float) for name in Motions._fields))
    return CalibratedCompensator(inner, motions=motions, units=inner.units, **found)
