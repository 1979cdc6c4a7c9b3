"""Parametric meshes of robot parts, to experiment with or to fit to a real part."""

import numpy as np

from hysteresis import InputError

from ._mesh import Mesh


def forearm(
    length: float = 0.26,
    elbow: tuple[float, float] = (0.055, 0.045),
    wrist: tuple[float, float] = (0.038, 0.028),
    around: int = 48,
    along: int = 48,
) -> Mesh:
    """A tapered elliptic cylinder along z with rounded ends; P_o is the middle of the end at the elbow.

        x = a(z) cos v,   y = b(z) sin v,       (a, b) from `elbow` at z = 0 to `wrist` at z = length

    **Arguments:** `length` and the half widths in m; `around`, `along`: how many divisions the mesh has.

    **Raises:** `InputError` where a length is not positive, or there are fewer than 3 divisions.

    **Example:**

        >>> shell = compensate.armor.forearm(around=12, along=4)
        >>> shell.corners().shape, round(float(shell.longest()), 3)
        ((168, 3, 3), 0.333)
    """
    part = np.linspace(0, 1, along + 1)
    widths = np.outer(1 - part, elbow) + np.outer(part, wrist)
    # A quarter of an ellipse before and behind closes the ends.
    cap = np.linspace(0, np.pi / 2, max(around // 6, 2) + 1)[1:-1]
    below = [(-elbow[1] * np.cos(a), *(np.sin(a) * np.array(elbow))) for a in cap]
    above = [(length + wrist[1] * np.sin(a), *(np.cos(a) * np.array(wrist))) for a in cap]
    middle = [(z, *w) for z, w in zip(length * part, widths, strict=True)]
    return _turned(np.array(below + middle + above), (-elbow[1], length + wrist[1]), around)


def head(
    half_axes: tuple[float, float, float] = (0.095, 0.075, 0.12),
    neck: float = 0.05,
    neck_length: float = 0.08,
    around: int = 64,
    along: int = 48,
) -> Mesh:
    """An ellipsoid on a round neck along z, rounded into it; P_o is the middle of the neck's foot.

    Under the chin the surface is concave, so a line of action may enter it twice.

    **Arguments:** half axes along x, y, z, radius and length of the neck, in m; `around`, `along`: how many
    divisions the mesh has.

    **Raises:** `InputError` where a length is not positive, the neck is thicker than the head, or there are
    fewer than 3 divisions.

    **Example:**

        >>> shell = compensate.armor.head(around=12, along=8)
        >>> shell.corners().shape, round(float(shell.longest()), 3)
        ((240, 3, 3), 0.289)
    """
    ax, ay, az = half_axes
    if not 0 < neck < min(ax, ay):
        raise InputError(
            "bad-option", f"a neck of radius {neck:g} m does not fit under a head of {min(ax, ay):g} m.",
            fix="give a radius below the head's half axes.",
        )  # fmt: skip
    # Where the ellipsoid is as wide as the neck, on its lower half.
    low = np.arccos(-np.sqrt(1 - (neck / min(ax, ay)) ** 2))
    angle = np.linspace(low, 0, along + 1)[:-1]
    centre = neck_length - az * np.cos(low)
    rings = np.stack([centre + az * np.cos(angle), ax * np.sin(angle), ay * np.sin(angle)], axis=1)
    foot = np.linspace(0, neck_length, max(along // 4, 2), endpoint=False)
    straight = np.stack([foot, np.full_like(foot, neck), np.full_like(foot, neck)], axis=1)
    return _turned(np.vstack([straight, rings]), (0.0, centre + az), around)


def _turned(rings: np.ndarray, ends: tuple[float, float], around: int) -> Mesh:
    """Ellipses (z, half width in x, in y) one above the other, closed by a point at either end."""
    if (
        around < 3
        or len(rings) < 2
        or not (rings[:, 1:] > 0).all()
        or not (np.diff(rings[:, 0]) > 0).all()
    ):
        raise InputError(
            "bad-option", "these lengths and divisions make no body.",
            fix="give positive lengths and three divisions or more.",
        )  # fmt: skip
    turn = 2 * np.pi * np.arange(around) / around
    z, x, y = rings.T
    points = np.stack(
        [np.outer(x, np.cos(turn)), np.outer(y, np.sin(turn)), np.outer(z, np.ones(around))], axis=2
    )
    vertices = np.vstack([points.reshape(-1, 3), [[0, 0, ends[0]], [0, 0, ends[1]]]])
    first = np.arange(len(rings) * around).reshape(len(rings), around)
    beside = np.roll(first, -1, axis=1)
    a, b, c, d = first[:-1].ravel(), beside[:-1].ravel(), beside[1:].ravel(), first[1:].ravel()
    bottom, top = np.full(around, len(vertices) - 2), np.full(around, len(vertices) - 1)
    triangles = [
        [a, b, c], [a, c, d], [bottom, beside[0], first[0]], [top, first[-1], beside[-1]],
    ]  # fmt: skip
    return Mesh(vertices, np.hstack([np.stack(t) for t in triangles]).T)
