"""A model as plain data and arrays, and back; only classes of ours are made."""

from dataclasses import fields
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from hysteresis import (
    BoucWen,
    Burgers,
    ChannelMap,
    DegradingBoucWen,
    FoamCurve,
    GeneralizedKelvinVoigt,
    GeneralizedMaxwell,
    InputError,
    LinearSponge,
    MonotoneCurve,
    MovingPreisach,
    NonlinearMaxwell,
    OutputDependentPreisach,
    Pinching,
    PrandtlIshlinskii,
    Preisach,
    Scaled,
    Series,
    Softening,
    StandardLinearSolid,
    Sum,
)
from hysteresis.curves import Clip, MonotoneSpline, PolynomialCurve
from hysteresis.preisach import (
    FactorisedDensity,
    GaussianDensity,
    GridDensity,
    LogNormalDensity,
    LorentzianDensity,
    NetworkDensity,
    RidgeDensity,
    SumDensity,
)

_CLASSES = {
    c.__name__: c
    for c in (
        LinearSponge, Burgers, PrandtlIshlinskii, Preisach, MovingPreisach, OutputDependentPreisach,
        GridDensity, FactorisedDensity, NetworkDensity, RidgeDensity, SumDensity,
        GaussianDensity, LorentzianDensity, LogNormalDensity,
        StandardLinearSolid, GeneralizedKelvinVoigt, GeneralizedMaxwell,
        FoamCurve, MonotoneCurve, MonotoneSpline, PolynomialCurve, Clip,
        BoucWen, DegradingBoucWen, Pinching,
        NonlinearMaxwell, Softening, Sum, Series, Scaled, ChannelMap,
    )
}  # fmt: skip


def describe_model(model: eqx.Module, prefix: str = "") -> tuple[dict[str, Any], dict[str, Any]]:
    """A model as plain data plus named arrays: class, static fields, numbers, nested models."""
    kind, arrays = type(model).__name__, {}
    structure: dict[str, Any] = {"class": kind}
    for field in fields(model):
        value, name = getattr(model, field.name), prefix + field.name
        if isinstance(value, eqx.Module):
            structure[field.name], nested = describe_model(value, f"{name}.")
            arrays |= nested
        elif isinstance(value, tuple) and any(isinstance(part, eqx.Module) for part in value):
            parts = [describe_model(part, f"{name}.{k}.") for k, part in enumerate(value)]
            structure[field.name] = [described for described, _ in parts]
            arrays |= {key: array for _, nested in parts for key, array in nested.items()}
        elif eqx.is_array(value):
            structure[field.name] = {"array": name}
            arrays[name] = np.asarray(value)
        else:
            structure[field.name] = value
    return structure, arrays


def rebuild_model(structure: dict[str, Any], arrays: dict[str, Any]) -> Any:
    """The inverse of `describe_model`. Raises `InputError` for a class that is not one of ours."""
    if structure.get("class") not in _CLASSES:
        raise InputError(
            "unknown-model",
            f"the file names the class {structure.get('class')!r}; known are {', '.join(_CLASSES)}.",
        )

    def rebuilt(value: Any) -> Any:
        if isinstance(value, list):
            return tuple(rebuilt(part) for part in value)
        if not isinstance(value, dict):
            return value
        return (
            rebuild_model(value, arrays)
            if "class" in value
            else jnp.asarray(arrays[value["array"]])
        )

    values = {name: rebuilt(value) for name, value in structure.items() if name != "class"}
    return _CLASSES[structure["class"]](**values)
