"""Vectors, faces and fields of `_armor`, as plain numbers."""

from collections.abc import Callable, Sequence
from math import exp
from typing import Any

Vector = tuple[float, float, float]
Field = Callable[[int, Vector], float]


def dot(a: Sequence[float], b: Sequence[float]) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Sequence[float], b: Sequence[float]) -> Vector:
    return (
        a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0],
    )  # fmt: skip


def square(a: Sequence[float], b: Sequence[float]) -> float:
    """|a - b|^2."""
    x, y, z = a[0] - b[0], a[1] - b[1], a[2] - b[2]
    return x * x + y * y + z * z


def moved(point: Vector, by: float, way: Vector) -> Vector:
    """point + by way."""
    return (point[0] + by * way[0], point[1] + by * way[1], point[2] + by * way[2])


def crossing(
    normal: Vector, offset: float, force: Vector, foot: Vector, along: float
) -> tuple[Vector, Vector, Vector]:
    """`compensate.armor`'s point, ahead and aside of one face."""
    point = moved(foot, -(offset + dot(normal, foot)) / along, force)
    ahead = (force[0] / along, force[1] / along, force[2] / along)
    return point, ahead, (ahead[0] - normal[0], ahead[1] - normal[1], ahead[2] - normal[2])


def outside(sides: list[tuple[float, float, float, float]], point: Vector) -> float:
    """How far a point of a face's plane lies beyond the face's edges."""
    x, y, z = point
    return max(a * x + b * y + c * z - limit for a, b, c, limit in sides)


def field(document: dict[str, Any]) -> tuple[Field, bool]:
    """A field of the cover, and whether it is the same all over a surface."""
    kind = document["kind"]
    if kind == "uniform":
        value = document["value"]
        if isinstance(value, list):
            return lambda surface, point: value[surface - 1], True
        return lambda surface, point: value, True
    if kind == "bumps":
        return _bumps(**document), False
    if kind == "grid":
        return _grid(**document), False
    raise ValueError(f"no field {kind!r}")


def _bumps(kind: str, centre: Any, amplitude: Any, width: float, base: Any) -> Field:
    twice = 2 * width * width

    def at(surface: int, point: Vector) -> float:
        k = surface - 1
        return base[k] + amplitude[k] * exp(-square(point, centre[k]) / twice)

    return at


def _grid(kind: str, values: Any, centre: Any, axes: Any) -> Field:
    rows, columns = len(values[0]) - 1, len(values[0][0]) - 1

    def cell(k: int, axis: int, away: Vector, cells: int) -> tuple[int, float]:
        way = axes[k][axis]
        along = min(max(dot(way, away) / dot(way, way), -1.0), 1.0)
        at = (along + 1.0) / 2.0 * cells
        first = min(int(at), cells - 1)
        return first, at - first

    def at(surface: int, point: Vector) -> float:
        k = surface - 1
        middle = centre[k]
        away = (point[0] - middle[0], point[1] - middle[1], point[2] - middle[2])
        (i, u), (j, v) = cell(k, 0, away, rows), cell(k, 1, away, columns)
        near, far = values[k][i], values[k][i + 1]
        low = near[j] * (1 - u) + far[j] * u
        high = near[j + 1] * (1 - u) + far[j + 1] * u
        return low * (1 - v) + high * v

    return at
