"""Plane faces, the form in which the solver sees every shape."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from hysteresis import InputError

METRES = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "in": 0.0254}

LARGEST, SMALLEST = 10.0, 0.005
"""Metres between which a robot's shell lies: outside, the unit is wrong."""


class Faces(NamedTuple):
    """Faces k of a body, seen from P_o:

        f_k(P) = offset_k + normal_k . P >= 0              within the body
        D_k    = {P : edge_ke . P <= limit_ke for all e}     the face itself, where f_k(P) = 0

    `normal` points inwards; `edge` outwards, in the face's plane, both of length 1. `surface` counts
    from 1; it is 0 for a face that is there only to fill a list.
    """

    normal: Float[Array, "faces 3"]
    offset: Float[Array, " faces"]
    edge: Float[Array, "faces edges 3"]
    limit: Float[Array, "faces edges"]
    surface: Int[Array, " faces"]


def dots(a: Array, b: Array) -> Array:
    """a . b along the last axis, written out: XLA fuses this, and calls a library for the other."""
    products = a * b
    return products[..., 0] + products[..., 1] + products[..., 2]


def polygon_faces(corners: np.ndarray) -> Faces:
    """Faces of plane convex polygons, (faces, corners, 3), counter-clockwise seen from outside.

    One with fewer corners than the others repeats its last.
    """
    sides = np.roll(corners, -1, axis=1) - corners
    outwards = _unit(np.cross(corners - corners[:, :1], sides).sum(axis=1))
    edge = _unit(np.cross(sides, outwards[:, None, :]))
    # A repeated corner makes a side without length, which must never be the one that decides.
    none = ~sides.any(axis=2)
    limit = np.where(none, np.ptp(corners), (edge * corners).sum(axis=2))
    offset = (outwards[:, None, :] * corners).sum(axis=2).mean(axis=1)
    surface = 1 + np.arange(len(corners))
    return Faces(*map(jnp.asarray, (-outwards, offset, edge, limit, surface)))


def _unit(v: np.ndarray) -> np.ndarray:
    length = np.linalg.norm(v, axis=-1, keepdims=True)
    return v / np.where(length > 0, length, 1.0)


def check_size(longest: float, what: str) -> None:
    """Raises `InputError` where a body of this longest side is not given in metres."""
    if not SMALLEST <= longest <= LARGEST:
        raise InputError(
            "wrong-unit",
            f"this {what} is {longest:g} m long.",
            cause="lengths in millimetres." if longest > LARGEST else "lengths scaled twice.",
            fix='give metres: 0.3, not 300; Mesh.load(path, unit="mm") for a file (--shape-unit mm).',
        )
