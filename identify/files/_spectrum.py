"""A spectrum as plain data and arrays, beside the fit it belongs to."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from hysteresis import GeneralizedKelvinVoigt, GeneralizedMaxwell

from ..noise._residual_statistics import Noise
from ..spectra._extrapolation import Allowed
from ..spectra._spectrum import Order, Spectrum


def spectrum_words(found: Spectrum) -> dict[str, Any]:
    """What fit.json says about a spectrum."""
    return {
        "kind": found.kind,
        "order": found.order,
        "table": [row._asdict() for row in found.table],
        "noise": found.noise._asdict(),
        "step": found.step,
        "span": found.span,
        "notes": list(found.notes),
    }


def spectrum_arrays(found: Spectrum) -> dict[str, np.ndarray]:
    """The spectra at the edge, for fit.npz."""
    return {f"spectrum_{name}": value for name, value in found.allowed._asdict().items()}


def rebuild_spectrum(
    words: dict[str, Any],
    arrays: Mapping[str, np.ndarray],
    model: GeneralizedKelvinVoigt | GeneralizedMaxwell,
) -> Spectrum:
    """The inverse of the two; the answers of other orders are not kept."""
    changed = {
        "model": model,
        "table": tuple(Order(**row) for row in words["table"]),
        "noise": Noise(**words["noise"]),
        "allowed": Allowed(*(arrays[f"spectrum_{name}"] for name in Allowed._fields)),
        "notes": tuple(words["notes"]),
    }
    return Spectrum(**words | changed)
