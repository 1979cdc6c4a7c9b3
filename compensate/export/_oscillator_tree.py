"""An oscillator as an element, from force to displacement, and where `Program` expects a compensator."""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from hysteresis import InputError, Oscillator
from hysteresis.dynamics._layout import Layout, layout_of

from .._contract import Estimate, Status
from ._node import Tree, node

LONGEST = 10.0
"""Samples that one step may last: with longer steps Newmark's method no longer follows the motion."""


def exportable(model: Oscillator) -> Layout:
    """The arrays of its hysteresis. Raises `InputError` `not-exportable` where it has none."""
    layout = layout_of(model.hysteresis)
    if layout is None or model.integrator != "newmark" or model.between != "linear":
        raise InputError(
            "not-exportable",
            "this oscillator cannot be exported.",
            cause="its hysteresis is not made of plays and one BoucWenForce (n = 1) or DuhemForce, or"
            " it is not integrated by Newmark's method with a straight force.",
            fix="fit it with identify.fit(record, 'Oscillator').",
        )
    return layout


def oscillator_node(model: Oscillator) -> Tree:
    """The element: its `find` goes from force to displacement."""
    layout = exportable(model)
    knots, none = layout.rate.shape[1], np.zeros(max(len(layout.radii), 1))
    cells = np.asarray(layout.counts, float) - 1
    return node(
        "oscillator",
        {
            "substeps": model.substeps, "mass": model.mass, "damping": model.damping,
            "stiffness": model.stiffness, "knots": knots, "limit": layout.limit,
            "per": (knots - 1) / (2 * layout.limit) if knots else 0.0, "rate": layout.rate,
            "plays": len(layout.radii), "radii": layout.radii, "low": -layout.reach,
            "scale": cells / (2 * layout.reach), "first": layout.first[:-1].astype(float), "cells": cells,
            "heights": layout.heights,
        },
        {
            "begun": 0, "y": 0.0, "v": 0.0, "a": 0.0, "z": 0.0, "force": 0.0, "play": none, "next": none,
            "f": 0.0, "steep": 0.0, "total": 0.0, "stretch": 0.0,
        },
    )  # fmt: skip


class Motion(NamedTuple):
    """An oscillator where a compensator is expected: readings are forces, estimates displacements."""

    model: Oscillator

    def simulate(self, t: Any, force: Any) -> Estimate:
        """The displacements from rest; at rest, where no force is known."""
        u = np.asarray(force, float)
        if not np.isfinite(u).all():
            return Estimate(jnp.zeros(len(u)), jnp.full(len(u), int(Status.INVALID)))
        found = self.model.displacement(np.asarray(t, float) - float(t[0]), u)
        return Estimate(jnp.asarray(found), jnp.full(len(u), int(Status.OK)))
