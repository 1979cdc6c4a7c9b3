"""The armor's solver on triangle meshes."""

from typing import Any

import jax
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from compensate.armor import ContactSolver, ContactStatus, ContactStream, Mesh, forearm, head
from tests.refusals import refuses

CUBE = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (0, 2)]) * [0.3, 0.25, 0.275]
SIDES = np.array(
    [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6],
     [1, 5, 7], [1, 7, 3], [0, 2, 6], [0, 6, 4]]
)  # fmt: skip
ARM, HEAD = forearm(around=24, along=16), head(around=32, along=16)


def presses(mesh: Mesh, count: int, seed: int) -> tuple[np.ndarray, ...]:
    """Triangle, place on it, and a slanting force of 1.6 N or more along its normal."""
    random, corners = np.random.default_rng(seed), mesh.corners()
    normal = np.asarray(mesh.faces().normal)
    k = random.integers(0, len(corners), count)
    share = random.dirichlet([1, 1, 1], count)
    along = random.uniform(1.6, 20, (count, 1))
    aside = random.normal(size=(count, 3)) * along
    aside -= (aside * normal[k]).sum(1, keepdims=True) * normal[k]
    return k, np.einsum("nc,nci->ni", share, corners[k]), along * normal[k] + aside


@pytest.mark.parametrize("mesh", [ARM, HEAD], ids=["forearm", "head"])
def test_every_contact_put_is_among_those_found(mesh: Mesh):
    """And is the one told, unless that is said to be AMBIGUOUS."""
    _, point, force = presses(mesh, 300, 0)
    solver = ContactSolver(mesh)
    contact = solver.solve(force, np.cross(point, force))
    away = np.linalg.norm(np.asarray(contact.point) - point, axis=1)
    status = np.asarray(contact.status)
    # Rounding of a point 0.3 m off, over the least n.F / |F| of the draws, 0.1.
    assert away[status == ContactStatus.OK].max() < 1e-13
    assert set(status) <= {ContactStatus.OK, ContactStatus.AMBIGUOUS}
    for n in np.flatnonzero(status == ContactStatus.AMBIGUOUS):
        listed = solver.candidates(force[n], np.cross(point[n], force[n]))
        assert np.linalg.norm(np.asarray(listed.point) - point[n], axis=1).min() < 1e-13


@given(st.integers(0, 10_000))
def test_the_search_overlooks_nothing(seed: int):
    """All triangles that a line crosses, found by looking at every one."""
    random = np.random.default_rng(seed)
    force, moment = random.normal(size=(2, 20, 3)) * [[[9]], [[0.5]]]
    near = HEAD.search(force, moment, np.zeros((20, 9)), np.zeros(20), np.zeros(20))
    faces: Any = jax.tree.map(np.asarray, HEAD.faces())
    foot = np.cross(force, moment) / (force**2).sum(1, keepdims=True)
    along = force @ faces.normal.T
    off = (faces.offset + foot @ faces.normal.T) / along
    point = foot[:, None] - off[..., None] * force[:, None]
    outside = (np.einsum("kei,nki->nke", faces.edge, point) - faces.limit).max(axis=2)
    for n, row in enumerate(near):
        assert set(np.flatnonzero(outside[n] < 0)) <= set(row) - {-1}


def test_a_mesh_in_a_stream():
    _, point, force = presses(ARM, 5, 4)
    moment = np.cross(point, force)
    solver = ContactSolver(ARM)
    stream = ContactStream(solver)
    pushed = enumerate(zip(force, moment, strict=True))
    found = [stream.step(0.1 * n, *now).surface for n, now in pushed]
    np.testing.assert_array_equal(found, solver.solve(force, moment).surface)


@pytest.mark.parametrize(("vertices", "triangles", "code"), [
    (CUBE, SIDES[1:], "not-a-mesh"), (CUBE, SIDES[:, ::-1], "not-a-mesh"),
    (CUBE, np.vstack([SIDES[:1, ::-1], SIDES[1:]]), "not-a-mesh"),
    (1000 * CUBE, SIDES, "wrong-unit"), (CUBE, SIDES + 1, "not-a-mesh"),
    (CUBE[:, :2], SIDES, "not-a-mesh"),
])  # fmt: skip
def test_what_is_no_surface_is_refused(vertices: Any, triangles: Any, code: str):
    refuses(code, lambda: Mesh(vertices, triangles))


@pytest.mark.parametrize("ending", ["stl", "obj"])
def test_files_are_read(tmp_path: Any, ending: str):
    trimesh = pytest.importorskip("trimesh")
    path = tmp_path / f"cube.{ending}"
    trimesh.Trimesh(1000 * CUBE, SIDES, process=False).export(path)
    refuses("wrong-unit", lambda: Mesh.load(path))
    assert float(Mesh.load(path, "mm").longest()) == pytest.approx(0.6)
    path.write_text("nothing")
    refuses("not-a-mesh", lambda: Mesh.load(path))


def test_bodies_that_are_none_are_refused():
    refuses("bad-option", lambda: head(neck=0.2))
    refuses("bad-option", lambda: forearm(length=-0.1))
