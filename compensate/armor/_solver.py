"""From a wrench to the contact: where the line of action meets the pressed-in cover."""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float, Int
from numpy.typing import ArrayLike

from hysteresis import InputError, Scalar, parameter
from hysteresis._parameter import as_float, is_concrete

from .. import _traced as traced
from .._contract import in_few_lengths
from ..runtime._contact import ContactStatus, Limits, Solver, Touch, solved, touched
from ._cover import Cover, Material, as_cover
from ._shapes import AbstractShape, dots


class Contact(NamedTuple):
    """Where the load's line of action meets the cover. All arrays have the wrench's leading shape.

    - `point` (..., 3), m: P^e, where the load acts, on the line of action.
    - `surface`: number of the touched surface, from 1; 0 where none was found.
    - `displacement`, m: d_n, how far the cover is pressed in along its normal.
    - `status`: a `ContactStatus`.
    - `spin`, N m: M.F/|F|, the torque about the line of action, which a point contact cannot exert.
    - `normal` (..., 3): of the touched surface, inwards.
    - `normal_force`, N: n.F.
    - `outside`, m: how far the touched point lies beyond the surface's edge; not above 0 within.

    Where no surface is found but some are pushed, point and displacement are those of the surface that
    the line of action passes closest. Where none is pushed they are 0, never NaN.
    """

    point: Float[Array, "*contacts 3"]
    surface: Int[Array, "*contacts"]
    displacement: Float[Array, "*contacts"]
    status: Int[Array, "*contacts"]
    spin: Float[Array, "*contacts"]
    normal: Float[Array, "*contacts 3"]
    normal_force: Float[Array, "*contacts"]
    outside: Float[Array, "*contacts"]

    @property
    def touched(self) -> Float[Array, "*contacts 3"]:
        """P^i = P^e - d_n n, m: the touched point of the surface before it was pressed."""
        return self.point - self.displacement[..., None] * self.normal


CHUNK = 8192
"""Contacts solved at a time: what they need in between stays in the cache."""

DWELL = np.geomspace(1e-3, 1.0, 10)
"""Parts of the dwell time after which a rate-dependent material takes a step."""

TURNS = 5
"""Rounds for a displacement that depends on where it is, see `settle`."""

ROUNDING = {64: 1e-9, 32: 1e-4}
"""Of the shape's size, by the precision: points closer than this are one point."""


class ContactSolver(eqx.Module):
    """The contact behind a wrench at P_o, for a shape under a soft cover.

    A load F with the moment M about P_o acts along the line P(l) = (F x M) / |F|^2 + l F. On each
    surface k that it pushes, F_n = n_k.F >= threshold, it acts where the line meets the surface as far
    as it is pressed in:

        f_k(P) = d_n(F_n),      l = (d_n - offset_k - n_k.(F x M) / |F|^2) / F_n

    The contact lies on the surface whose domain D_k holds this point. Where more than one does, the one
    pushed most squarely is taken, which needs the least friction; if their points are farther apart than
    they are pressed in, the status is AMBIGUOUS. Where none does, the one that comes closest is taken, if
    it is within `tolerance` of its edge.

    **Arguments:**

    - `shape`: `Box`, `Convex` or `Mesh`.
    - `compensator`: what the cover gives way, a `Cover` or what `Cover` takes; None is rigid.
    - `threshold`, N: of the normal force, below which nothing is touched.

    **Other arguments:**

    - `tolerance`, m: how far beyond an edge a contact may come to lie by the wrench's error. By default
      a twentieth of the longest side of the shape: three times the paper's mean error.
    - `spin_limit`, m: the spin torque |M.F|/|F| that a contact can transmit, over its normal force. A
      patch of radius a with the friction coefficient mu reaches 2/3 mu a. Beyond it the status is
      SECOND_SUPPORT: the shell bears on something else too, or the sensor errs. By default it is not
      judged. Two pushes whose sum passes through the shell without spin no wrench can tell from one.
    - `release`, N: a contact in a stream ends below it; by default 0.8 of the threshold, so that noise
      does not make it chatter.
    - `same_place`, m, and `recovery`, s: a touch within these of the last one finds the material as that
      one left it, see `step`. By default 15 mm, the paper's probe, and 60. All times are in the unit of
      the material's model if that does not carry its units.
    - `dwell`, s: how long a load has rested when `solve` is asked, for materials that creep: they give way
      less in the first moment than in a stream. A stream knows its times, and does not use it.

    Raises `InputError` where the threshold or a limit is negative, and where 20 N would press the cover
    through the shape, which is a matter of units; `solve` and `candidates` raise `no-time` for a material
    that creeps, without a `dwell`.

    Source: Tsuji 2014, equations (1) to (17); its equation (3) divides by F_x and F_y, the form here
    only by F_n.

    **Example:**

        >>> contact = solver.solve([0.0, 0.0, -10.0], [0.0, 0.0, 0.0])
        >>> int(contact.surface), round(float(contact.displacement), 4)
        (1, 0.0192)
    """

    shape: AbstractShape
    cover: Cover
    threshold: Scalar = parameter(unit="N", fixed=True)
    tolerance: Scalar = parameter(unit="m", fixed=True)
    spin_limit: Scalar = parameter(unit="m", fixed=True)
    release: Scalar = parameter(unit="N", fixed=True)
    same_place: Scalar = parameter(unit="m", fixed=True)
    recovery: Scalar = parameter(unit="time", fixed=True)
    dwell: float | None = eqx.field(default=None, static=True)
    creeps: bool = eqx.field(default=False, static=True)

    def __init__(
        self,
        shape: AbstractShape,
        compensator: Material = None,
        threshold: ArrayLike = 1.5,
        *,
        tolerance: ArrayLike | None = None,
        spin_limit: ArrayLike = float("inf"),
        release: ArrayLike | None = None,
        same_place: ArrayLike = 0.015,
        recovery: ArrayLike = 60.0,
        dwell: float | None = None,
    ):
        self.shape, self.cover, self.threshold = shape, as_cover(compensator), as_float(threshold)
        self.tolerance = shape.longest() / 20 if tolerance is None else as_float(tolerance)
        self.release = 0.8 * self.threshold if release is None else as_float(release)
        self.spin_limit, self.same_place = as_float(spin_limit), as_float(same_place)
        self.recovery, self.dwell = as_float(recovery), None if dwell is None else float(dwell)
        known = all(map(is_concrete, jax.tree.leaves(self.cover)))
        self.creeps = known and self.cover.creeps()

    def __check_init__(self) -> None:
        names = ("threshold", "tolerance", "spin_limit", "release", "same_place", "recovery")
        limits = [getattr(self, name) for name in names]
        if all(map(is_concrete, limits)) and not all(float(limit) >= 0 for limit in limits):
            raise InputError(
                "bad-option",
                "a threshold, tolerance or other limit is negative or no number.",
                fix="give forces in N and lengths in m, or leave them out.",
            )
        if self.dwell is not None and not 0 < self.dwell < float("inf"):
            raise InputError(
                "bad-option", f"a dwell time of {self.dwell:g} s.", fix="give seconds above 0."
            )
        if not all(map(is_concrete, jax.tree.leaves((self.shape, self.cover)))):
            return
        with jax.ensure_compile_time_eval():
            pressed, longest = self.cover.hard_push(), float(self.shape.longest())
        if not pressed < longest / 2:
            raise InputError(
                "wrong-unit",
                f"20 N would press the cover in by {pressed:.3g} m, and the shape is {longest:.3g} m long.",
                cause="millimetres taken for metres.",
                fix='Cover(compensator, length_unit="mm"), and the shape in metres.',
            )

    def solve(self, force: ArrayLike, moment: ArrayLike, doubt: ArrayLike | None = None) -> Contact:
        """The contacts behind wrenches of any leading shape, each as the first touch of a virgin cover.

        **Arguments:** `force` (..., 3), N, and `moment` (..., 3), N m about P_o, both exerted by the load;
        `doubt`: (...), a `ContactStatus` per wrench that overrules ours where it is not OK, as
        `WristSensor.read` returns it.
        """
        force, moment, doubt = _wrenches(force, moment, doubt)
        self._check_dwell()
        return _solve(self, force, moment, doubt, _nearby(self, force, moment))

    def candidates(self, force: ArrayLike, moment: ArrayLike) -> Contact:
        """All that one wrench may have touched, the likeliest first: arrays (faces, ...).

        The status is OK where the point lies within the surface or the tolerance around it, MISSED beyond.
        Places in the list that no pushed surface fills hold NO_CONTACT.
        """
        force, moment, _ = _wrenches(force, moment, None)
        self._check_dwell()
        return _listed(self, force, moment, _nearby(self, force, moment))

    def _check_dwell(self) -> None:
        if self.dwell is None and self.creeps:
            raise InputError(
                "no-time",
                "this cover creeps, so one wrench without its history does not say how far it gave way.",
                fix="use simulate, step or ContactStream (--stream); or ContactSolver(..., dwell=seconds).",
            )

    def init(self) -> Touch:
        """The state of a stream before anything was touched."""
        zero = jnp.zeros_like(self.threshold)
        none, place = jnp.zeros((), int), jnp.zeros((3,), zero.dtype)
        status = jnp.asarray(int(ContactStatus.NO_CONTACT), int)
        contact = Contact(place, none, zero, status, zero, place, zero, zero)
        return Touch(jnp.zeros((), bool), none, place, zero - jnp.inf, self.cover.init(), contact)

    def step(
        self,
        state: Touch,
        t: ArrayLike | None,
        force: ArrayLike,
        moment: ArrayLike,
        doubt: ArrayLike | None = None,
    ) -> tuple[Touch, Contact]:
        """One wrench of a stream, with the history of the cover at the touched place.

        A contact begins at the threshold and ends below `release`. The material starts virgin, goes on
        with its history as long as the contact stays on one surface, and recovers after release as its
        model does without a force. A touch at the same place within `recovery` goes on from there; one
        elsewhere, or later, finds virgin material. Only the place touched last is remembered, and a
        contact that slides takes its history along.

        A wrench or time that is not finite changes nothing: the last contact is held, INVALID.

        **Arguments:** `t`, s; the others as of `solve`, for one
        wrench. `ContactStream` runs this at full speed.
        """
        force, moment, doubt = _wrenches(force, moment, doubt)
        t = jnp.asarray(t, force.dtype)
        return _step(self, state, t, force, moment, doubt, _nearby(self, force, moment))

    def simulate(
        self,
        t: ArrayLike | None,
        force: ArrayLike,
        moment: ArrayLike,
        doubt: ArrayLike | None = None,
    ) -> Contact:
        """`step` over all wrenches (samples, 3) of a stream, from `init`."""
        force, moment, doubt = _wrenches(force, moment, doubt)
        doubt = jnp.broadcast_to(jnp.asarray(doubt), len(force))
        t, near = jnp.asarray(t, force.dtype), _nearby(self, force, moment)
        return in_few_lengths(_stream, self, self.init(), t, force, moment, doubt, near)[1]

    def limits(self) -> Limits:
        """What contacts are judged by."""
        rounding = ROUNDING[jnp.finfo(jnp.result_type(self.tolerance)).bits] * self.shape.longest()
        return Limits(
            self.threshold, self.release, self.tolerance, self.spin_limit, rounding, self.same_place,
            self.recovery,
        )  # fmt: skip

    def _text(self) -> Solver:
        return Solver(traced, Contact, self.cover, self.limits(), TURNS)

    def _virgin(self, force: Array, moment: Array, doubt: Any, near: Array | None) -> Any:
        """Of one wrench, on a cover that was never touched."""
        first, text = self.cover.init(), self._text()

        def held(surface: Any, along: Array, point: Any) -> tuple[Any, Array, Array]:
            """Under a force that has been held for the dwell time."""
            state, pressed, beyond = self.cover.press(first, 0.0, along)
            for t in () if self.dwell is None else (self.dwell * DWELL).tolist():
                state, pressed, beyond = self.cover.press(state, t, along)
            return state, pressed, beyond

        faces, threshold = self.shape.faces(near), text.limits.threshold
        return solved(text, faces, force, moment, doubt, threshold, first, held)


def _nearby(solver: ContactSolver, force: Array, moment: Array) -> Array | None:
    # Not a method: Equinox takes 0.1 ms to bind one, and small batches are solved as fast.
    def most(cosines: Array) -> Array:
        return _most(solver.cover, force, cosines.astype(force.dtype))

    return solver.shape.nearby(force, moment, most, solver.threshold, solver.tolerance)


@eqx.filter_jit
def _solve(
    solver: ContactSolver, force: Array, moment: Array, doubt: Any, near: Array | None
) -> Contact:
    def one(*wrench: Any) -> Contact:
        return solver._virgin(*wrench)[1]

    # Each contact needs a row for every face in between. For a large batch these leave the cache, so
    # `lax.map` solves it in chunks, one after the other.
    leading = force.shape[:-1]
    doubt = jnp.broadcast_to(doubt, leading)
    wrenches = jax.tree.map(
        lambda a: a.reshape(-1, *a.shape[len(leading) :]), (force, moment, doubt, near)
    )
    if len(wrenches[0]) <= CHUNK:
        contact = jax.vmap(one)(*wrenches)
    else:
        contact = jax.lax.map(lambda wrench: one(*wrench), wrenches, batch_size=CHUNK)
    return jax.tree.map(lambda a: a.reshape(leading + a.shape[1:]), contact)


@eqx.filter_jit
def _step(
    solver: ContactSolver, state: Touch, t: Array, force: Array, moment: Array, doubt: Any,
    near: Array | None,
) -> tuple[Touch, Contact]:  # fmt: skip
    faces = solver.shape.faces(near)
    return touched(solver._text(), faces, state, t, force, moment, doubt)


@eqx.filter_jit
def _stream(solver: ContactSolver, state: Touch, *samples: Any) -> tuple[Touch, Contact]:
    return jax.lax.scan(lambda own, now: _step(solver, own, *now), state, samples)


@eqx.filter_jit
def _most(cover: Cover, force: Array, cosines: Array) -> Array:
    """Largest indentation of any face under these components of each force, m."""
    sizes = jnp.sqrt(dots(force, force))
    normal = sizes[..., None] * jnp.broadcast_to(cosines, (*sizes.shape, len(cosines)))
    return jax.vmap(cover.most)(normal.ravel()).reshape(normal.shape)


@eqx.filter_jit
def _listed(solver: ContactSolver, force: Array, moment: Array, near: Array | None) -> Contact:
    *_, found, told = solver._virgin(force, moment, _SURE, near)

    def alone(one: Any) -> Contact:
        known = jnp.where(one.far, int(ContactStatus.EXTRAPOLATED), int(ContactStatus.OK))
        missed = jnp.where(one.pushed, int(ContactStatus.MISSED), int(ContactStatus.NO_CONTACT))
        contact = told(one, known)
        return contact._replace(status=jnp.where(contact.surface > 0, known, missed))

    order = jnp.lexsort((-found.along, found.cost))
    return jax.vmap(alone)(jax.tree.map(lambda a: a[order], found))


_SURE = np.zeros((), int)


def _wrenches(force: Any, moment: Any, doubt: Any) -> tuple[Array, Array, Any]:
    force, moment = jnp.asarray(force, float), jnp.asarray(moment, float)
    if force.shape != moment.shape or force.shape[-1:] != (3,):
        raise InputError(
            "wrong-shape",
            f"force of shape {force.shape} and moment of shape {moment.shape} make no wrenches.",
            fix="give both as (..., 3): x, y, z last.",
        )
    return force, moment, _SURE if doubt is None else jnp.asarray(doubt, int)


class ContactStream:
    """`ContactSolver.step` compiled for a loop in Python: state inside, NumPy in, NumPy out.

    XLA passes the small parts of a step from thread to thread, which takes most of the time. In a process
    on one core (`taskset -c 0 python ...`) a step takes only a third to two thirds of it.

    **Example:**

        >>> stream = compensate.armor.ContactStream(solver)
        >>> contact = stream.step(0.0, [0.0, 0.0, -10.0], [0.0, 0.0, 0.0])
        >>> contact.surface, round(float(contact.displacement), 4)
        (1, 0.0192)
    """

    def __init__(self, solver: ContactSolver):
        state = solver.init()
        whole, dtype = (state, state.contact), state.place.dtype

        def packed(whole: Any) -> tuple[Array, Callable[[Array], Any]]:
            return ravel_pytree(jax.tree.map(lambda leaf: leaf.astype(dtype), whole))

        def moved(before: Array, sample: Array) -> Array:
            own = jax.tree.map(lambda x, like: x.astype(like.dtype), unpacked(before), whole)[0]
            t, force, moment, doubt = sample[0], sample[1:4], sample[4:7], sample[7].astype(int)
            return packed(solver.step(own, t, force, moment, doubt))[0]

        self._first, unpacked = packed(whole)

        # What enters and leaves the compiled step costs more than the step: one array each, 14 us instead
        # of 53 for the state's own.
        self._step, self._dtype = jax.jit(moved), dtype
        self.reset()
        jax.block_until_ready(self._step(self._packed, np.zeros(8, dtype)))

    def reset(self) -> None:
        """As before the first sample."""
        self._packed = self._first

    def step(
        self, t: ArrayLike | None, force: ArrayLike, moment: ArrayLike, doubt: ArrayLike = 0
    ) -> Contact:
        """The contact at the time `t`, as NumPy values; arguments as of `ContactSolver.step`."""
        sample = np.empty(8, self._dtype)
        sample[0], sample[1:4], sample[4:7], sample[7] = t, force, moment, doubt
        self._packed = self._step(self._packed, sample)
        v = np.asarray(self._packed)[-12:]
        whole: Any = (v[0:3], int(v[3]), v[4], int(v[5]), v[6], v[7:10], v[10], v[11])
        return Contact(*whole)
