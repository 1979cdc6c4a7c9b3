"""`uniaxialMaterial` lines of OpenSees: the force of a deformation, by materials that make a model up.

    Parallel             the sum of the materials below, material 1
    Elastic, Maxwell     a relaxing model: E_inf, and a spring E behind a dashpot E tau for each term
    BoucWen              the same equation, with A = 1
    Elastic, ElasticPP   a line and stop operators, of a Prandtl-Ishlinskii model that leads its input
    ElasticMultiLinear   a curve without memory

Source: the manual of OpenSees, uniaxialMaterial command.
"""

from collections.abc import Iterator
from typing import Any

import jax.numpy as jnp
import numpy as np

from hysteresis import AbstractModel, BoucWen, InputError, MonotoneCurve, PrandtlIshlinskii, Sum
from hysteresis.models._viscoelastic import AbstractViscoelastic

from ._prony_terms import prony_of

Material = tuple[str, str]
"""Its name, and what comes after its tag."""


def uniaxial_materials(model: AbstractModel) -> tuple[list[str], list[str]]:
    """The lines, and what they do not hold. Raises `InputError` `not-exportable`."""
    made = [*_materials(model)]
    first = 1 if len(made) == 1 else 2
    lines = [
        f"uniaxialMaterial {name} {tag} {values}" for tag, (name, values) in enumerate(made, first)
    ]
    if first > 1:
        tags = " ".join(map(str, range(2, 2 + len(made))))
        lines.append(f"uniaxialMaterial Parallel 1 {tags}")
    force = float(np.asarray(model.simulate(np.arange(2.0), np.zeros(2)))[0])
    notes = ["Material 1 takes the deformation that the fit had as its input."]
    if any(name == "Maxwell" for name, _ in made):
        notes.append("Maxwell materials need a transient analysis, whose time is that of the fit.")
    if abs(force) > 1e-12:
        notes.append(f"The force at no deformation, {force:.6g}, is left out.")
    return lines, notes


def _materials(model: AbstractModel) -> Iterator[Material]:
    if isinstance(model, Sum):
        for part in model.parts:
            yield from _materials(part)
    elif isinstance(model, AbstractViscoelastic):
        at_end, E, tau = prony_of(model)
        if at_end > 0:
            yield "Elastic", _words(at_end)
        for stiffness, time in zip(E, tau, strict=True):
            yield "Maxwell", _words(stiffness, stiffness * time, 1.0, 1.0)
    elif isinstance(model, BoucWen):
        beta, gamma = model.coefficients()
        yield "BoucWen", _words(model.alpha, model.k, model.n, gamma, beta, 1, 0, 0, 0)
    elif isinstance(model, MonotoneCurve):
        u = jnp.asarray(model.nodes)
        force = model.curve(u) - model.curve(jnp.zeros(1))
        yield "ElasticMultiLinear", f"-strain {_words(*u)} -stress {_words(*force)}"
    elif isinstance(model, PrandtlIshlinskii) and model.leading and not _is_bent(model):
        yield "Elastic", _words(model.slope)
        for weight, radius in zip(model.weights, model.thresholds, strict=True):
            if weight > 0:
                yield "ElasticPP", _words(weight, radius)
    else:
        raise InputError(
            "not-exportable",
            f"No material of OpenSees is a {type(model).__name__} as it was fitted.",
            fix="Fit --model BoucWen, PrandtlIshlinskii (force over deformation), or a relaxing one.",
        )


def _is_bent(model: PrandtlIshlinskii) -> bool:
    return model.rates is not None or model.bends is not None


def _words(*values: Any) -> str:
    return " ".join(f"{float(x):.12g}" for x in values)
