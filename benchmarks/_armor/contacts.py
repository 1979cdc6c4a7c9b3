"""The armor's solver: exact, none lost, how fast; batches, streams, with and without JAX."""

import tempfile
import time
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np

from compensate.armor import (
    Box,
    ContactSolver,
    ContactStatus,
    ContactStream,
    Convex,
    Mesh,
    export_armor,
    forearm,
    head,
)
from compensate.runtime import load
from hysteresis import LinearSponge

from .._measure import Row, judged, least_seconds, noted
from .one_core import on_one_core

BOX = Box(0.3, 0.3, 0.55)
SPONGE = LinearSponge(1.298, 6.186)
EXACT = "rigid, exact wrench"
BATCH = "batch, contacts on the box, soft"
STREAM = "one contact, streaming, Python"
NO_TRIMESH = "trimesh and rtree are not installed: pip install 'hysid[mesh]' rtree"

Presses = tuple[np.ndarray, np.ndarray, np.ndarray]


def contact_rows(quick: bool) -> list[Row]:
    """Every bar on the solver."""
    count = 100_000 if quick else 1_000_000
    return [
        *_exact("box", BOX, _on_box(count, 0), count),
        *_exact("convex mesh", *_convex(count), count),
        *_among(head(), 20_000 if quick else 200_000),
        *_degenerate(),
        *_batches(quick),
        *_mesh_against_trimesh(quick),
        *_streams(5_000 if quick else 20_000),
    ]


def _slanting(normal: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Forces of 1.6 to 30 N along each normal, and as much aside."""
    along = random.uniform(1.6, 30, (len(normal), 1))
    aside = random.normal(size=normal.shape) * along
    return along * normal + aside - (aside * normal).sum(1, keepdims=True) * normal


def _on_box(count: int, seed: int) -> Presses:
    """Surface, point and force of rigid contacts."""
    random, faces = np.random.default_rng(seed), BOX.faces()
    k, normal = random.integers(0, 5, count), np.asarray(faces.normal)
    inside = random.uniform(-1, 1, (count, 3)) * [0.3, 0.3, 0.275] + [0, 0, 0.275]
    depth = (inside * normal[k]).sum(1) + np.asarray(faces.offset)[k]
    return k + 1, inside - depth[:, None] * normal[k], _slanting(normal[k], random)


def _on_triangles(normal: np.ndarray, corners: np.ndarray, count: int, seed: int) -> Presses:
    random = np.random.default_rng(seed)
    k, share = random.integers(0, len(corners), count), random.dirichlet([1, 1, 1], count)
    return k + 1, np.einsum("nc,nci->ni", share, corners[k]), _slanting(normal[k], random)


def _convex(count: int) -> tuple[Convex, Presses]:
    """An icosahedron, 0.2 m from the middle to its corners."""
    g = (1 + 5**0.5) / 2
    points = [(s, t * g, 0) for s in (-1, 1) for t in (-1, 1)]
    vertices = np.array([np.roll(p, n) for p in points for n in range(3)]) * 0.2 / np.hypot(1, g)
    near = np.linalg.norm(vertices[:, None] - vertices[None], axis=2) < 0.22
    found = [
        (a, b, c) for a in range(12) for b in range(a) for c in range(b)
        if near[a, b] and near[b, c] and near[a, c]
    ]  # fmt: skip
    out = [np.linalg.det(vertices[list(t)]) > 0 for t in found]
    body = Convex(vertices, [t if o else t[::-1] for t, o in zip(found, out, strict=True)])
    corners = vertices[[t if o else t[::-1] for t, o in zip(found, out, strict=True)]]
    return body, _on_triangles(np.asarray(body.faces().normal), corners, count, 1)


def _exact(what: str, shape: Any, presses: Presses, count: int) -> list[Row]:
    surface, point, force = presses
    contact = ContactSolver(shape).solve(force, np.cross(point, force))
    away = np.linalg.norm(np.asarray(contact.point) - point, axis=1).max()
    wrong = int((np.asarray(contact.surface) != surface).sum())
    lost = int((np.asarray(contact.status) != ContactStatus.OK).sum())
    return [
        judged(f"{EXACT}, {count:,} on {what}: farthest off, m", float(away), 1e-9),
        judged(f"{EXACT}, {what}: on a wrong surface", wrong, 0),
        judged(f"{EXACT}, {what}: lost", lost, 0),
    ]


def _among(mesh: Mesh, count: int) -> list[Row]:
    """A body with a hollow: the truth is told, or listed and said to be AMBIGUOUS."""
    normal = np.asarray(mesh.faces().normal)
    _, point, force = _on_triangles(normal, mesh.corners(), count, 2)
    solver, moment = ContactSolver(mesh), np.cross(point, force)
    contact = solver.solve(force, moment)
    off = np.linalg.norm(np.asarray(contact.point) - point, axis=1) > 1e-9
    several = np.asarray(contact.status) == ContactStatus.AMBIGUOUS
    lost = np.isin(contact.status, (ContactStatus.OK, ContactStatus.AMBIGUOUS), invert=True)
    missing = 0
    looked_at = np.flatnonzero(off)[:500]
    for n in looked_at:
        listed = np.asarray(solver.candidates(force[n], moment[n]).point)
        missing += np.linalg.norm(listed - point[n], axis=1).min() > 1e-9
    return [
        judged(
            f"{EXACT}, {count:,} on a head: not found and not told", int((off & ~several).sum()), 0
        ),
        judged(f"{EXACT}, head: lost", int(lost.sum()), 0),
        judged(
            f"{EXACT}, head: truth not among the candidates, of {len(looked_at)}", int(missing), 0
        ),
        noted("    AMBIGUOUS, part of all", float(several.mean())),
    ]


def _degenerate() -> list[Row]:
    """Forces along every axis and diagonal of the surfaces' planes, square ones among them."""
    faces, wrong = BOX.faces(), 0
    solver, point = ContactSolver(BOX), np.asarray(BOX.centres())
    for normal, middle, k in zip(np.asarray(faces.normal), point, range(1, 6), strict=True):
        first, second = np.eye(3)[normal == 0]
        slants = [a * first + b * second for a in (-1, 0, 1) for b in (-1, 0, 1)]
        force = 10 * (normal + np.array(slants))
        contact = solver.solve(force, np.cross(middle, force))
        away = np.linalg.norm(np.asarray(contact.point) - middle, axis=1)
        wrong += int(((away > 1e-9) | (np.asarray(contact.surface) != k)).sum())
    return [judged(f"{EXACT}, degenerate directions: not solved, of 45", wrong, 0)]


def _batches(quick: bool) -> list[Row]:
    """Soft contacts: how many a second, and what one costs in small and large batches."""
    solver, sizes = ContactSolver(BOX, SPONGE), [10**n for n in range(3, 7 if quick else 8)]
    _, point, force = _on_box(sizes[-1], 3)
    moment = jnp.asarray(np.cross(point, force))
    force = jnp.asarray(force)
    parts = {n: (force[:n], moment[:n]) for n in sizes}
    calls = {str(n): lambda part=part: solver.solve(*part) for n, part in parts.items()}
    seconds = least_seconds(calls, 3 if quick else 5)
    cost = {n: 1e9 * seconds[str(n)] / n for n in sizes}
    rows = [noted(f"    batch of {n:,}: ns a contact", cost[n]) for n in sizes]
    flat = max(cost.values()) / cost[10**6]
    return [
        judged(f"{BATCH}: million contacts a second", 1e3 / cost[10**6], 1.0, at_least=True),
        judged(f"{BATCH}: dearest batch, 1e3 to {sizes[-1]:.0e}, over that of 1e6", flat, 2.0),
        *rows,
    ]


def _mesh_against_trimesh(quick: bool) -> list[Row]:
    what = "mesh of 10,000 triangles: times faster than trimesh, ray by ray"
    try:
        import rtree as _  # trimesh's rays need it
        import trimesh
    except ImportError:
        return [noted(what, np.nan, reason=NO_TRIMESH)]
    mesh = forearm(around=72, along=46)
    corners = mesh.corners()
    count, looped = 20_000 if quick else 100_000, 100 if quick else 300
    _, point, force = _on_triangles(np.asarray(mesh.faces().normal), corners, count, 4)
    solver, moment = ContactSolver(mesh), np.cross(point, force)
    body = trimesh.Trimesh(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))
    along = force / np.linalg.norm(force, axis=1, keepdims=True)
    body.ray.intersects_location(point[:1] - along[:1], along[:1])
    begin, differ = time.perf_counter(), 0
    rays = [
        body.ray.intersects_location(point[n : n + 1] - along[n : n + 1], along[n : n + 1])[0]
        for n in range(looped)
    ]
    theirs = (time.perf_counter() - begin) / looped
    calls = {"ours": lambda: solver.solve(force, moment)}
    ours = least_seconds(calls, 3)["ours"] / count
    for n, hits in enumerate(rays):
        listed = solver.candidates(force[n], moment[n])
        found = np.asarray(listed.point)[np.asarray(listed.surface) > 0]
        # All our entries are among their hits, which are entries and exits.
        differ += any(np.linalg.norm(hits - p, axis=1).min() > 1e-9 for p in found)
        differ += np.linalg.norm(found - point[n], axis=1).min() > 1e-9
    return [
        judged(what, theirs / ours, 20.0, at_least=True),
        judged(f"the same: other answers than trimesh's, of {looped}", int(differ), 0),
        noted(f"the same, {len(corners):,} triangles: us a contact", 1e6 * ours),
    ]


def _streams(steps: int) -> list[Row]:
    """One contact after the other, as a loop in Python sees it."""
    k = np.arange(steps)
    force = (8 + 7 * np.sin(k / 50))[:, None] * np.array([0.1, 0.05, -1.0])
    moment = np.cross([0.1, 0.05, 0.53], force)
    solver = ContactSolver(BOX, SPONGE)
    stream = ContactStream(solver)
    with tempfile.TemporaryDirectory() as folder:
        armor = load(export_armor(solver, Path(folder) / "armor.json"))
    t, both = (0.01 * k).tolist(), np.hstack([force, moment]).tolist()
    compiled = [_timed(stream.step, *now) for now in zip(t, force, moment, strict=True)]
    plain = [_timed(armor.step, *now) for now in zip([0.01] * steps, both, strict=True)]
    away = [
        np.abs(np.array(b.point) - a.point).max()
        for (a, _), (b, _) in zip(compiled, plain, strict=True)
    ]
    return [
        judged(f"{STREAM}: JAX, process kept on one core, median us", on_one_core(), 100.0),
        noted("    on any core: XLA hands over between threads, us", _median(compiled)),
        judged(f"{STREAM}: the runtime, median us", _median(plain), 30.0),
        judged(f"{STREAM}: the runtime against JAX, farthest off, m", float(max(away)), 1e-9),
    ]


def _timed(step: Any, *now: Any) -> tuple[Any, float]:
    begin = time.perf_counter_ns()
    told = step(*now)
    return told, (time.perf_counter_ns() - begin) / 1e3


def _median(runs: list[tuple[Any, float]]) -> float:
    return float(np.median([us for _, us in runs]))
