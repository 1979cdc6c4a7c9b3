"""The armor's solver: contacts found are contacts put."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from compensate import invert
from compensate.armor import Box, Bumps, ContactSolver, ContactStatus, Convex, Cover
from hysteresis import Burgers, FoamCurve, InputError, LinearSponge, PrandtlIshlinskii
from hysteresis.internal import Units, conversion, with_units
from tests.refusals import refuses
from tests.thorough import rest_thorough

BOX = Box(0.3, 0.25, 0.55, 0.1)
SPONGE = LinearSponge(1.298, 6.186)
PLAYS = PrandtlIshlinskii([1.0, 3.0, 6.0], [0.2, 0.2, 0.3], 0.5, offset=3.0)
PLAYS = with_units(PLAYS, Units("N", "mm"))
CREEPING = Burgers(1.0, 2.0, 20.0, 5.0, units=("N", "mm", "s"))
LOCAL = Cover(
    SPONGE,
    factor=Bumps(BOX.centres(), 0.1, 0.06, 0.94),
    compliance=Bumps(BOX.centres(), amplitude=np.linspace(0, 1e-4, 5), width=0.1),
)
COVERS = {"rigid": None, "local": LOCAL}

NORMALS = np.asarray(BOX.faces().normal)

covers = pytest.mark.parametrize("cover", COVERS.values(), ids=COVERS)


def octahedron() -> Convex:
    """Eight triangles around P_o, 0.2 m from it along every axis."""
    axes = 0.2 * np.vstack([np.eye(3), -np.eye(3)])
    signs = [(x, y, z) for x in (0, 3) for y in (1, 4) for z in (2, 5)]
    turned = [s if sum(k > 2 for k in s) % 2 == 0 else s[::-1] for s in signs]
    return Convex(axes, turned)


@st.composite
def presses(draw: st.DrawFn) -> tuple[int, np.ndarray, np.ndarray, float]:
    """A surface from 0, a place on it (-1 to 1 thrice), a force with a slant, and a spin torque."""
    unit = st.floats(-1, 1)
    surface = draw(st.integers(0, 4))
    place = np.array([draw(unit) for _ in range(3)])
    aside = np.array([draw(st.one_of(st.just(0.0), unit)) for _ in range(3)])
    normal, along = NORMALS[surface], draw(st.floats(1.6, 40))
    force = along * normal + 0.5 * along * (aside - (aside @ normal) * normal)
    return surface, place, force, draw(unit)


def put(
    solver: ContactSolver, surface: int, place: np.ndarray, force: np.ndarray, spin: float, reach: float
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """P^e of a press on the box, and its moment about P_o."""
    middle, half = np.array([0, 0, 0.325]), np.array([0.3, 0.25, 0.225])
    normal, force_n = NORMALS[surface], NORMALS[surface] @ force
    touched = middle + reach * place * half
    touched = touched - ((touched - middle) @ normal) * normal - (half @ abs(normal)) * normal
    cover = solver.cover
    pressed = cover.press(cover.init(), 0.0, jnp.asarray(force_n))[1]
    d = cover.displacement(
        pressed, jnp.asarray(force_n), jnp.asarray(surface + 1), jnp.asarray(touched)
    )
    point = touched + float(d) * normal
    return point, np.cross(point, force) + spin * force


@covers
@given(presses())
def test_contact_found_is_contact_put(cover: Any, press: Any):
    """Rigid anywhere on the box; soft where no second surface can give way by as much."""
    surface, place, force, spin = press
    solver = ContactSolver(BOX, cover)
    reach = 1.0 if cover is None else 0.6
    point, moment = put(solver, surface, place, force, spin, reach)
    contact = solver.solve(force, moment)
    listed = solver.candidates(force, moment)
    away = np.linalg.norm(np.asarray(listed.point) - point, axis=1)
    # Eight rounds of a map that contracts by 0.05 or better leave 1e-10 of 3 mm; the rest is rounding.
    assert away[np.asarray(listed.surface) > 0].min() < 1e-11
    # Beyond 25 N a sponge that was typed in is a guess, wherever it is touched.
    known = (ContactStatus.OK, ContactStatus.AMBIGUOUS, ContactStatus.EXTRAPOLATED)
    hard = cover is not None and force @ NORMALS[surface] > 25
    assert contact.status in (known if hard else known[:2])
    np.testing.assert_allclose(contact.spin, spin * np.linalg.norm(force), atol=1e-11)
    if cover is None:
        # On an edge both surfaces hold it.
        np.testing.assert_allclose(contact.point, point, atol=1e-12)


@given(
    st.lists(st.tuples(st.integers(0, 7), st.floats(0, 1), st.floats(0, 1)), min_size=4, max_size=4)
)
def test_convex_polygons_are_found(drawn: list[tuple[int, float, float]]):
    faces = octahedron().faces()
    solver = ContactSolver(octahedron(), SPONGE)
    k = np.array([d[0] for d in drawn])
    normal = np.asarray(faces.normal)[k]
    corners = -0.2 * np.sign(normal)[:, :, None] * np.eye(3)
    # A place inside the face, away from its edges.
    share = 0.2 + 0.2 * np.array([[d[1], d[2], 2 - d[1] - d[2]] for d in drawn])
    touched = np.einsum("nc,nci->ni", share / share.sum(1, keepdims=True), corners)
    d = 1e-3 * (1.298 * 5 + 6.186)
    contact = solver.solve(5 * normal, np.cross(touched + d * normal, 5 * normal))
    np.testing.assert_allclose(contact.point, touched + d * normal, atol=1e-14)
    np.testing.assert_allclose(contact.touched, touched, atol=1e-14)
    np.testing.assert_array_equal(contact.surface, k + 1)
    assert not np.asarray(contact.status).any()


STATUSES = [
    ([0, 0, 0], [0, 0, 0], ContactStatus.NO_CONTACT),
    ([0, 0, -1.4], [0, 0, 0], ContactStatus.BELOW_THRESHOLD),
    ([1.0, 0.0, 1.4], [0, 0.5, 0], ContactStatus.BELOW_THRESHOLD),
    ([0, 0, 15], [0, 0, 0], ContactStatus.PULLING),
    ([0, 0, 15], [0, 20, 0], ContactStatus.PULLING),
    ([0, 0, -15], [0, 20, 0], ContactStatus.MISSED),
    ([0, 0, -15], [0, 0, 1], ContactStatus.SECOND_SUPPORT),
    ([0, 0, -15], [0, 0, 0], ContactStatus.OK),
    ([np.nan, 0, -15], [0, 0, 0], ContactStatus.INVALID),
    ([0, 0, -15], [np.inf, 0, 0], ContactStatus.INVALID),
    # Along an edge: within 1.5 N of both sides, and square onto the top.
    ([0, 0, -15], [-15 * 0.25, 15 * 0.3, 0], ContactStatus.OK),
]


@pytest.mark.parametrize(("force", "moment", "status"), STATUSES)
def test_status(force: Any, moment: Any, status: ContactStatus):
    """Whatever comes in, what comes out is finite, has the right status and has finite gradients."""
    solver = ContactSolver(BOX, LOCAL, spin_limit=0.05)
    contact = solver.solve(force, moment)
    assert ContactStatus(int(contact.status)) is status
    touching = status in (ContactStatus.OK, ContactStatus.SECOND_SUPPORT)
    assert (int(contact.surface) > 0) == touching
    given_ = (solver, jnp.asarray(force, float), jnp.asarray(moment, float))
    gradient = eqx.filter_grad(lambda g: sum(map(jnp.sum, g[0].solve(*g[1:])[::2])))(given_)
    for leaf in jax.tree.leaves((contact, gradient)):
        assert np.isfinite(leaf).all()


def test_two_surfaces_apart_are_ambiguous():
    """At an edge a line may lie within both sides' soft layers; one dent they make, or two places."""
    solver, point = ContactSolver(BOX, SPONGE), [0.299, 0.0, 0.525]
    for aside, status in ((8.0, ContactStatus.OK), (1.6, ContactStatus.AMBIGUOUS)):
        force = np.array([-aside, 0, -15.0])
        moment = np.cross(point, force)
        contact, listed = solver.solve(force, moment), solver.candidates(force, moment)
        assert (int(contact.surface), int(contact.status)) == (1, status)
        assert listed.surface[:3].tolist() == [1, 4, 0]


@covers
def test_gradients_match_finite_differences(cover: Any):
    solver = ContactSolver(BOX, cover)
    force, point = np.array([2.0, 1.0, -15.0]), np.array([0.05, 0.06, 0.53])
    inputs = np.concatenate([force, np.cross(point, force)])

    def found(x: Any) -> Any:
        return solver.solve(x[:3], x[3:]).point

    step = 1e-5
    by_steps = [
        (np.asarray(found(inputs + e)) - np.asarray(found(inputs - e))) / (2 * step)
        for e in step * np.eye(6)
    ]
    exact = jax.jacfwd(found)(jnp.asarray(inputs))
    # Central differences: the square of the step against |F|, and rounding over the step.
    np.testing.assert_allclose(np.stack(by_steps, axis=1), exact, atol=1e-9)


# Streams


def force_in_waves(samples: int) -> np.ndarray:
    k = np.arange(samples)
    return np.maximum(8 + 7 * np.sin(k / 5) + 2 * np.sin(k / 1.3), 2.0)


@pytest.mark.parametrize("cover", [SPONGE, PLAYS, CREEPING])
def test_stream_has_the_cover_s_own_history(cover: Any):
    """d_n = simulate(t, F_n) while it is touched, and without history the batch's answer."""
    t, strength = 0.1 * np.arange(60), force_in_waves(60)
    strength[20:25] = 0.2  # lifted off
    force = strength[:, None] * np.array([0.1, 0.05, -1.0])
    moment = np.cross([0.05, 0.02, 0.53], force)
    solver = ContactSolver(BOX, cover, same_place=1.0, recovery=np.inf)
    contacts = solver.simulate(t, force, moment)
    touched = np.asarray(contacts.surface) == 1
    assert touched.sum() == 55
    found = np.asarray(contacts.displacement)
    if cover is SPONGE:
        np.testing.assert_allclose(found, solver.solve(force, moment).displacement, atol=1e-15)
        return
    wanted = 1e-3 * np.asarray(cover.simulate(t, np.where(touched, strength, 0)))
    np.testing.assert_allclose(found[touched], wanted[touched], atol=1e-14)


def pushes(solver: ContactSolver, strength: Any, t: Any = None, x: Any = 0.05) -> Any:
    """A stream of square pushes onto the top, at x."""
    t = 0.1 * np.arange(len(strength)) if t is None else t
    x = np.broadcast_to(x, len(strength))
    force = np.outer(strength, [0, 0, -1.0])
    moment = np.cross(np.stack([x, 0 * x, 0.55 + 0 * x], axis=1), force)
    return solver.simulate(t, force, moment)


def test_bad_samples_hold_the_contact_and_change_nothing():
    solver, strength = ContactSolver(BOX, PLAYS), force_in_waves(30)
    spoilt = strength.copy()
    spoilt[10] = np.nan
    good = pushes(solver, np.delete(strength, 10), np.delete(0.1 * np.arange(30), 10))
    held = pushes(solver, spoilt)
    assert int(held.status[10]) == ContactStatus.INVALID
    np.testing.assert_array_equal(held.point[10], held.point[9])
    for a, b in zip(good, held, strict=True):
        np.testing.assert_array_equal(a, np.delete(b, 10, axis=0))


# What is refused


def test_a_box_without_inside_is_refused():
    for sides in ((0.0, 0.3, 0.5, 0.0), (0.3, 0.3, 0.0, 0.1), (np.nan, 0.3, 0.5, 0.0)):
        refuses("bad-option", lambda sides=sides: Box(*sides))


def test_millimetres_for_metres_are_refused():
    refuses("wrong-unit", lambda: Box(300, 300, 550, 0))
    refuses("wrong-unit", lambda: ContactSolver(BOX, Cover(SPONGE, length_unit="m")))
    in_metres = LinearSponge(1.298e-3, 6.186e-3)
    refuses("wrong-unit", lambda: ContactSolver(BOX, in_metres))
    pushed = ([0, 0, -15.0], [0, 0, 0.0])
    np.testing.assert_allclose(
        ContactSolver(BOX, Cover(in_metres, length_unit="m")).solve(*pushed).point,
        ContactSolver(BOX, SPONGE).solve(*pushed).point,
    )
    refuses("unknown-unit", lambda: Cover(SPONGE, length_unit="N"))


def test_a_cover_the_wrong_way_round_is_refused():
    foam = FoamCurve(0.6, 0.3, 0.2, 5.0, 20.0, 20.0, 1.0, 0.1)
    known = with_units(foam, Units("mm", "N"))
    for gives_force in (invert(SPONGE), foam, known, invert(with_units(SPONGE, Units("N", "mm")))):
        refuses("wrong-direction", lambda gives_force=gives_force: Cover(gives_force))
    assert Cover(invert(known)).hard_push() > 1e-3
    refuses("no-unit", lambda: Cover(invert(foam)))
    assert Cover(invert(foam), length_unit="mm").hard_push() == Cover(invert(known)).hard_push()


@pytest.mark.parametrize(
    ("force", "length"), rest_thorough([("lbf", "inch"), ("gf", "cm"), ("mN", "mm")], 1)
)
def test_a_cover_is_converted_from_the_units_that_it_carries(force: str, length: str):
    """The same sponge in any units: d = K F + b above 1.5 N, known to 25 N."""
    newtons, metres = conversion(force, "N"), conversion(length, "m")
    same = LinearSponge(
        1.298e-3 * newtons / metres, 6.186e-3 / metres, 1.5 / newtons,
        units=(force, length), trained=(0.0, 25.0 / newtons),
    )  # fmt: skip
    loads = np.array([[0.0, 0, -1.6], [0, 0, -15.0], [0, -24.9, 0], [0, 0, -25.1]])
    found = ContactSolver(BOX, same).solve(loads, np.cross([0.01, 0.02, 0.3], loads))
    plain = ContactSolver(BOX, SPONGE).solve(loads, np.cross([0.01, 0.02, 0.3], loads))
    # Rounding of the conversions, of 39 mm.
    np.testing.assert_allclose(found.displacement, plain.displacement, atol=1e-15)
    np.testing.assert_allclose(found.point, plain.point, atol=1e-15)
    assert found.status.tolist() == [ContactStatus.OK] * 3 + [ContactStatus.EXTRAPOLATED]
    stream = ContactSolver(BOX, same).simulate(np.arange(4.0), loads, 0 * loads)
    assert stream.status[-1] == ContactStatus.EXTRAPOLATED


def test_units_that_contradict_are_refused():
    in_cm = with_units(SPONGE, Units("kgf", "cm"))
    assert Cover(in_cm, length_unit="cm", force_unit="kgf").scales[1] == 0.01
    for given_, code in (
        ({"length_unit": "mm"}, "wrong-unit"),
        ({"force_unit": "N"}, "wrong-unit"),
        ({"length_unit": "kg"}, "unknown-unit"),
        ({"thickness": 0.0}, "parameter-out-of-bounds"),
    ):
        refuses(code, lambda given_=given_: Cover(in_cm, **given_))
    refuses("wrong-unit", lambda: Cover(with_units(SPONGE, Units("V", "N"))))


def test_a_cover_that_creeps_needs_a_stream_or_a_dwell_time():
    load = np.array([0.0, 0.0, -15.0])
    refuses("no-time", lambda: ContactSolver(BOX, CREEPING).solve(load, 0 * load))
    refuses("bad-option", lambda: ContactSolver(BOX, CREEPING, dwell=0.0))
    held = ContactSolver(BOX, CREEPING, dwell=3.0).solve(load, 0 * load)
    t = np.array([0.0, 3.0])
    stream = ContactSolver(BOX, CREEPING).simulate(t, np.tile(load, (2, 1)), np.zeros((2, 3)))
    np.testing.assert_allclose(held.displacement, stream.displacement[-1], rtol=1e-12)
    # A clock in minutes is converted too.
    in_minutes = Burgers(1.0, 2.0 / 60, 20.0, 5.0 / 60, units=("N", "mm", "min"))
    again = ContactSolver(BOX, in_minutes, dwell=3.0).solve(load, 0 * load)
    np.testing.assert_allclose(again.displacement, held.displacement, rtol=1e-12)


def test_wrong_shapes_and_limits_are_refused():
    refuses("wrong-shape", lambda: ContactSolver(BOX).solve(np.zeros((4, 3)), np.zeros((3, 4))))
    refuses("bad-option", lambda: ContactSolver(BOX, threshold=-1))
    with pytest.raises(InputError, match="not-convex"):
        Convex(0.1 * np.vstack([np.eye(3), -np.eye(3)]), [(0, 1, 2), (3, 5, 4), (0, 2, 3, 5)])
    with pytest.raises(InputError, match="not-a-mesh"):
        Convex(0.1 * np.vstack([np.eye(3), -np.eye(3)]), [(2, 1, 0), (3, 5, 4)])
