"""Triangle meshes of any shape, also of those that a line enters more than once, and of parts of robots."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from numpy.typing import ArrayLike

from hysteresis import InputError
from hysteresis._parameter import is_concrete

from ._shapes import METRES, AbstractShape, Faces, check_size, polygon_faces

GROUP = 8
"""Spheres in a sphere."""


class Hierarchy:
    """Triangles in spheres of eight, those in spheres of eight, and so on up to eight or fewer.

    A line misses all that is in a sphere that it misses. NumPy goes down level by level with the pairs of
    a line and a sphere that are left, some fifty per line and level on a closed body.

    **Arguments:** `corners` (triangles, 3, 3).
    """

    def __init__(self, corners: np.ndarray):
        middle = (corners.min(axis=1) + corners.max(axis=1)) / 2
        radius = np.linalg.norm(corners - middle[:, None], axis=2).max(axis=1)
        # What rounding may do to the distance of a line from a sphere, generously.
        radius = radius + 1e-6 * np.ptp(corners)
        self.order: np.ndarray = _halved(middle, np.arange(len(corners)))
        level = middle[self.order], radius[self.order]
        self.levels: list[tuple[np.ndarray, np.ndarray]] = [level]
        while len(self.levels[0][0]) > GROUP:
            self.levels.insert(0, _around(*self.levels[0]))

    def near(
        self, foot: np.ndarray, along: np.ndarray, reach: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """All pairs (line, triangle) that are within the line's reach, and some that are not.

        **Arguments:** `foot`, `along`: (lines, 3), a point of each line and its direction, of length 1;
        `reach`: (lines,). The pairs are in the order of the lines.
        """
        line, node = np.indices((len(foot), len(self.levels[0][0]))).reshape(2, -1)
        for depth, (centre, radius) in enumerate(self.levels):
            if depth:
                line = np.repeat(line, GROUP)
                node = (node[:, None] * GROUP + np.arange(GROUP)).ravel()
                inside = node < len(radius)
                line, node = line[inside], node[inside]
            away = centre[node] - foot[line]
            ahead = np.einsum("ij,ij->i", away, along[line])
            within = np.einsum("ij,ij->i", away, away) - ahead**2
            kept = within <= (radius[node] + reach[line]) ** 2
            line, node = line[kept], node[kept]
        return line, self.order[node]


def _around(centre: np.ndarray, radius: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Bounding spheres of each eight consecutive items."""
    first = np.arange(0, len(centre), GROUP)
    middle = (np.minimum.reduceat(centre, first) + np.maximum.reduceat(centre, first)) / 2
    far = np.linalg.norm(centre - np.repeat(middle, GROUP, axis=0)[: len(centre)], axis=1) + radius
    return middle, np.maximum.reduceat(far, first)


def _halved(middle: np.ndarray, items: np.ndarray) -> np.ndarray:
    """An order of the items in which each eight, and each eight of those, are neighbours in space."""
    if len(items) <= GROUP:
        return items
    whole = GROUP
    while whole * GROUP < len(items):
        whole *= GROUP
    # The cut falls between groups of the level below, for these are told by counting alone.
    cut = whole * -(-len(items) // (2 * whole))
    axis = np.argmax(np.ptp(middle[items], axis=0))
    order = items[np.argsort(middle[items, axis], kind="stable")]
    return np.concatenate([_halved(middle, order[:cut]), _halved(middle, order[cut:])])


CAPACITY = 32
"""Triangles looked at for one contact at most: those that a line crosses, or comes nearest to."""

COSINES = np.linspace(0, 1, 9)
"""Angles between force and face at which the reach of a soft face is asked for."""

LINES = 4096
"""Lines searched at a time."""


class Mesh(AbstractShape):
    """A surface of triangles, in metres from P_o; triangle k is surface k + 1.

    A force presses each triangle under a soft cover in by its own d_n along its own normal. At a ridge
    the moved neighbours cross, and a line may meet both: these points are less than d_n apart and count as
    one contact; the solver takes the triangle that is pushed more squarely. In a fold the moved neighbours
    separate, and a line may pass between them: then the solver takes the closest one within the tolerance.

    Where a line enters the body more than once, `ContactSolver.candidates` lists all entries, and the
    status is AMBIGUOUS. The solver considers the 32 most likely triangles for each contact.

    **Arguments:**

    - `vertices` (vertices, 3), m.
    - `triangles` (triangles, 3): the indices of their corners, counter-clockwise seen from outside.
    - `rim`: whether the surface may end, as a shell's does where it is mounted.

    **Raises:** `InputError` for a surface with holes, triangles of both orientations, a surface that is
    inside out, and one whose size is not plausible in metres.

    **Example:**

        >>> corners = 0.1 * np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
        >>> shell = compensate.armor.Mesh(corners, [(0, 1, 2), (0, 3, 1), (0, 2, 3), (1, 3, 2)])
        >>> shell.corners().shape
        (4, 3, 3)
    """

    sides: Faces
    extent: Float[Array, ""]
    search: "Search" = eqx.field(static=True)

    def __init__(self, vertices: ArrayLike, triangles: ArrayLike, *, rim: bool = False):
        points, numbers = np.asarray(vertices, float), np.asarray(triangles, int)
        _check(points, numbers, rim)
        corners = points[numbers]
        extent = float(np.ptp(corners, axis=(0, 1)).max())
        self.sides, self.extent = polygon_faces(corners), jnp.asarray(extent, float)
        self.search = Search(self.sides, corners, extent)

    @classmethod
    def load(cls, path: str | Path, unit: str = "m", *, rim: bool = False) -> "Mesh":
        """The mesh of an STL, OBJ or other file that trimesh reads; `unit`: of its numbers.

        Raises `InputError` as `Mesh` does, where the file cannot be read, and where trimesh is missing.
        """
        if unit not in METRES:
            raise InputError(
                "unknown-unit", f"no length {unit!r}.", fix=f"one of {', '.join(METRES)}."
            )
        try:
            import trimesh
        except ImportError:
            raise InputError(
                "missing-extra", "files of meshes are read by trimesh, which is not installed.",
                fix="pip install 'hysid[mesh]'; or give a box, or vertices and triangles.",
            ) from None  # fmt: skip
        try:
            found: Any = trimesh.load_mesh(path)
        except Exception as error:  # each of its readers raises its own
            raise InputError(
                "not-a-mesh", f"cannot be read as a mesh: {error}.", place=str(path),
                fix="give an STL, OBJ, PLY or OFF file.",
            ) from None  # fmt: skip
        if not len(getattr(found, "faces", ())):
            raise InputError("not-a-mesh", "there are no triangles in it.", place=str(path))
        return cls(METRES[unit] * found.vertices, found.faces, rim=rim)

    def faces(self, near: Array | None = None) -> Faces:
        if near is None:
            return self.sides
        some = jax.tree.map(lambda a: a[near], self.sides)
        return some._replace(surface=jnp.where(near < 0, 0, some.surface))

    def corners(self) -> np.ndarray:
        """The triangles' corners (triangles, 3, 3), m."""
        return self.search.corners

    def longest(self) -> Float[Array, ""]:
        return self.extent

    def nearby(
        self,
        force: Array,
        moment: Array,
        most: Callable[[Array], Array],
        threshold: ArrayLike,
        tolerance: ArrayLike,
    ) -> Int[Array, "*contacts near"]:
        leading = force.shape[:-1]
        limits = (jnp.broadcast_to(jnp.asarray(limit), leading) for limit in (threshold, tolerance))
        wrench = (force, moment, most(jnp.asarray(COSINES)), *limits)
        if all(map(is_concrete, wrench)):
            return jnp.asarray(self.search(*map(np.asarray, wrench)))
        # Only whole numbers come back from the search: gradients pass it by.
        shape = jax.ShapeDtypeStruct((*leading, CAPACITY), np.int32)
        traced = map(jax.lax.stop_gradient, wrench)
        return jax.pure_callback(self.search.padded, shape, *traced, vmap_method="broadcast_all")


class Search:
    """Which triangles each line of action can have met: at most `CAPACITY`, the likeliest first."""

    def __init__(self, sides: Faces, corners: np.ndarray, extent: float):
        self.sides: Any = jax.tree.map(np.asarray, sides)
        self.corners: np.ndarray = corners
        self.spheres: Hierarchy = Hierarchy(corners)
        self.rounding: float = 1e-9 * extent

    def __call__(
        self, force: np.ndarray, moment: np.ndarray, reach: np.ndarray,
        threshold: np.ndarray, tolerance: np.ndarray,
    ) -> np.ndarray:  # fmt: skip
        """(..., near): numbers of triangles, filled up with -1; as many as any line needs.

        `reach` (..., cosines), m: how far a face at most is pressed in by n.F = |F| cosine.
        """
        leading = tolerance.shape
        flat = [force.reshape(-1, 3), moment.reshape(-1, 3)]
        flat += [reach.reshape(-1, len(COSINES)), threshold.ravel(), tolerance.ravel()]
        parts = [
            self._some(*(a[k : k + LINES] for a in flat)) for k in range(0, len(flat[0]), LINES)
        ]
        most = max((part.shape[1] for part in parts), default=1)
        whole = np.full((len(flat[0]), most), -1, np.int32)
        for k, part in enumerate(parts):
            whole[k * LINES : k * LINES + len(part), : part.shape[1]] = part
        return whole.reshape(*leading, most)

    def padded(self, *wrench: ArrayLike) -> np.ndarray:
        """`CAPACITY` for every line."""
        found = self(*map(np.asarray, wrench))
        more = [(0, 0)] * (found.ndim - 1) + [(0, CAPACITY - found.shape[-1])]
        return np.pad(found, more, constant_values=-1)

    def _some(
        self, force: np.ndarray, moment: np.ndarray, reach: np.ndarray,
        threshold: np.ndarray, tolerance: np.ndarray,
    ) -> np.ndarray:  # fmt: skip
        size = np.linalg.norm(force, axis=1)
        usable = np.flatnonzero(np.isfinite(size + moment.sum(axis=1)) & (size > 0))
        force, size = force[usable], size[usable]
        lines = (force / size[:, None], np.cross(force, moment[usable]) / size[:, None] ** 2)
        reach, tolerance = reach[usable], tolerance[usable]
        pairs = self._crossed(*lines, reach, np.zeros_like(tolerance))
        line, _, _, cosine, met = pairs
        hit = np.zeros(len(usable), bool)
        hit[line[met & (cosine >= (threshold[usable] / size)[line])]] = True
        # A line that pushes nothing where it passes is looked at again with all that it comes close to.
        rest = np.flatnonzero(~hit)
        if len(rest):
            again = self._crossed(*(a[rest] for a in (*lines, reach, tolerance)))
            again, first = (rest[again[0]], *again[1:]), hit[line]
            pairs = tuple(np.concatenate([a[first], b]) for a, b in zip(pairs, again, strict=True))
        line, triangle, cost, cosine, _ = pairs
        order = np.lexsort((-cosine, cost, line))
        line, triangle = line[order], triangle[order]
        place = np.arange(len(line)) - np.searchsorted(line, line)
        kept = place < CAPACITY
        most = int(place[kept].max(initial=0)) + 1
        # Powers of two only: the solver is compiled once for each length of the list.
        near = np.full((len(moment), 1 << (most - 1).bit_length()), -1)
        near[usable[line[kept]], place[kept]] = triangle[kept]
        return near

    def _crossed(
        self, along: np.ndarray, foot: np.ndarray, reach: np.ndarray, tolerance: np.ndarray
    ) -> tuple[np.ndarray, ...]:
        """Pairs (line, triangle) that can meet, how far apart they are at least, n.F/|F|, and whether the
        line crosses the triangle where it lies unpressed."""
        # Pressed in by d, the touched point lies aside of the line by d sin(angle between F and n).
        widest = (reach[:, 1:] * np.sqrt(1 - COSINES[:-1] ** 2)).max(axis=1)
        line, triangle = self.spheres.near(foot, along, widest + tolerance)
        normal = self.sides.normal[triangle]
        cosine = np.einsum("ij,ij->i", normal, along[line])
        crossed = np.abs(cosine) > 1e-9
        line, triangle, normal, cosine = (a[crossed] for a in (line, triangle, normal, cosine))
        height = self.sides.offset[triangle] + np.einsum("ij,ij->i", normal, foot[line])
        point = foot[line] - (height / cosine)[:, None] * along[line]
        beyond = np.einsum("ijk,ik->ij", self.sides.edge[triangle], point)
        beyond = (beyond - self.sides.limit[triangle]).max(axis=1)
        # In the face's plane that is d tan(angle).
        cell = np.minimum(np.searchsorted(COSINES, np.maximum(cosine, 0)), len(COSINES) - 1)
        aside = reach[line, cell] * np.sqrt(np.maximum(1 - cosine**2, 0)) / np.abs(cosine)
        met = beyond <= self.rounding
        apart = np.where(beyond - aside <= self.rounding, 0, beyond - aside)
        close = apart <= tolerance[line]
        return line[close], triangle[close], apart[close], cosine[close], met[close]


def _check(points: np.ndarray, triangles: np.ndarray, rim: bool) -> None:
    """Raises `InputError` for a mesh that is not a surface oriented outwards."""
    if points.ndim != 2 or points.shape[1] != 3 or triangles.ndim != 2 or triangles.shape[1] != 3:
        raise InputError(
            "not-a-mesh", f"vertices {points.shape} and triangles {triangles.shape} make no mesh.",
            fix="give (vertices, 3) and (triangles, 3).",
        )  # fmt: skip
    if not np.isfinite(points).all() or not len(triangles):
        raise InputError("not-a-mesh", "there are no triangles, or corners that are no numbers.")
    if triangles.min() < 0 or triangles.max() >= len(points):
        raise InputError("not-a-mesh", "a triangle has a corner that is no vertex.")
    check_size(float(np.ptp(points, axis=0).max()), "mesh")
    sides = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    there, back = (sides @ [len(points), 1], sides @ [1, len(points)])
    if len(np.unique(there)) < len(there):
        raise InputError(
            "not-a-mesh", "neighbouring triangles are turned opposite ways, or lie doubled.",
            fix="trimesh.repair.fix_normals(mesh), or recalculate the normals where it was drawn.",
        )  # fmt: skip
    alone = int((~np.isin(there, back)).sum())
    if alone and not rim:
        raise InputError(
            "not-a-mesh", f"the surface is open: {alone} sides have a triangle on one side only.",
            cause="a hole, or vertices that were not merged.",
            fix="close it where it was drawn, or trimesh.repair.fill_holes(mesh), mesh.merge_vertices();"
            " rim=True where it has to end.",
        )  # fmt: skip
    a, b, c = (points - points.mean(axis=0))[triangles].transpose(1, 0, 2)
    if np.einsum("ij,ij->", a, np.cross(b, c)) <= 0:
        raise InputError(
            "not-a-mesh", "the surface is inside out: it encloses a negative volume.",
            cause="triangles clockwise, or a mirrored axis.",
            fix="triangles[:, ::-1], mesh.invert(), or turn it where it was drawn.",
        )  # fmt: skip


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
    straight = np.stack([foot, *np.full((2, len(foot)), neck)], axis=1)
    return _turned(np.vstack([straight, rings]), (0.0, centre + az), around)


def _turned(rings: np.ndarray, ends: tuple[float, float], around: int) -> Mesh:
    """Ellipses (z, half width in x, in y) one above the other, closed by a point at either end."""
    rises = (rings[:, 1:] > 0).all() and (np.diff(rings[:, 0]) > 0).all()
    if around < 3 or len(rings) < 2 or not rises:
        raise InputError(
            "bad-option", "these lengths and divisions make no body.",
            fix="give positive lengths and three divisions or more.",
        )  # fmt: skip
    turn = 2 * np.pi * np.arange(around) / around
    z, x, y = rings.T
    ways = ((x, np.cos(turn)), (y, np.sin(turn)), (z, np.ones(around)))
    points = np.stack([np.outer(*pair) for pair in ways], axis=2)
    vertices = np.vstack([points.reshape(-1, 3), [[0, 0, ends[0]], [0, 0, ends[1]]]])
    first = np.arange(len(rings) * around).reshape(len(rings), around)
    beside = np.roll(first, -1, axis=1)
    a, b, c, d = first[:-1].ravel(), beside[:-1].ravel(), beside[1:].ravel(), first[1:].ravel()
    bottom, top = np.full(around, len(vertices) - 2), np.full(around, len(vertices) - 1)
    triangles = [
        [a, b, c], [a, c, d], [bottom, beside[0], first[0]], [top, first[-1], beside[-1]],
    ]  # fmt: skip
    return Mesh(vertices, np.hstack([np.stack(t) for t in triangles]).T)
