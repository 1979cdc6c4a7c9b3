"""From a wrench to the contact: one text for `compensate.armor` and for plain Python, see `_arithmetic`."""

from collections.abc import Callable
from enum import IntEnum
from math import inf
from typing import NamedTuple

from ._arithmetic import Arithmetic, Items, Numbers, Real, State, Test

# What a contact is worth.


class ContactStatus(IntEnum):
    """What a contact is worth. Only the first is to be used without a thought."""

    OK = 0
    NO_CONTACT = 1
    """No force to speak of, less than a tenth of the threshold: no line of action is known."""
    BELOW_THRESHOLD = 2
    """No surface is pushed with the threshold's force."""
    PULLING = 3
    """The force leaves through a surface: nothing that only touches can pull."""
    MISSED = 4
    """The line of action passes by every surface that the force could push."""
    AMBIGUOUS = 5
    """The line enters several surfaces apart; the likeliest is given, `candidates` lists all."""
    INVALID = 6
    """A channel was NaN or infinite."""
    SATURATED = 7
    """A channel of the sensor stood at the end of its range: the point is off by an unknown amount."""
    SECOND_SUPPORT = 8
    """More spin torque than the contact can transmit: something else bears on the shell."""
    EXTRAPOLATED = 9
    """The force is beyond those of the cover's fit, or the cover is pressed in further than it is thick."""


(
    OK, NO_CONTACT, BELOW_THRESHOLD, PULLING, MISSED, AMBIGUOUS, INVALID, SATURATED, SECOND_SUPPORT,
    EXTRAPOLATED,
) = ContactStatus  # fmt: skip

NONE = (0.0, 0.0, 0.0)

Face = State
Point = tuple[Real, Real, Real]

Trial = Callable[[Real, Real, Numbers], tuple[State, Real, Test]]
"""From a face's number, F_n and where the line crosses it: the cover after this force, g(F_n), and whether
that is beyond what is known."""


class Limits(NamedTuple):
    """What a contact is judged by, see `ContactSolver`: N, m, s; `rounding`, m, is taken for nothing."""

    threshold: Real
    release: Real
    tolerance: Real
    spin: Real
    rounding: Real
    same_place: Real
    recovery: Real


class Solver(NamedTuple):
    """What all functions here need: the arithmetic `o`, the kind of a contact, and how often a displacement
    that depends on its place is found anew."""

    o: Arithmetic
    contact: State
    cover: State
    limits: Limits
    turns: int


class Candidate(NamedTuple):
    """What a face would make of a wrench: F_n, P^e, P^i, d_n, and how far P^i lies beyond its edge, m.

    - `cost`: the same, 0 within it, infinite where the face is not pushed.
    - `far`: whether the material is pushed further than its fit knows, or than it is thick.
    - `cover`: the state after it.
    """

    pushed: Test
    surface: Real
    normal: Numbers
    along: Real
    point: Numbers
    touched: Numbers
    displacement: Real
    outside: Real
    cost: Real
    far: Test
    cover: State


class Touch(NamedTuple):
    """What is known of the present contact, or of the last one.

    - `touching`: whether there is one.
    - `surface`, `place` (m): where, P^i; surface 0 before the first.
    - `time`: of the last sample with contact.
    - `cover`: the state of the material there.
    - `contact`: the last one told.
    """

    touching: Test
    surface: Real
    place: Numbers
    time: Real
    cover: State
    contact: State


def dot(a: Numbers, b: Numbers) -> Real:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Numbers, b: Numbers) -> Point:
    return (
        a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0],
    )  # fmt: skip


def square(a: Numbers, b: Numbers) -> Real:
    """|a - b|^2."""
    x, y, z = a[0] - b[0], a[1] - b[1], a[2] - b[2]
    return x * x + y * y + z * z


def moved(point: Numbers, by: Real, way: Numbers) -> Point:
    """point + by way."""
    return point[0] + by * way[0], point[1] + by * way[1], point[2] + by * way[2]


def solved(
    s: Solver, faces: Items, force: Numbers, moment: Numbers, doubt: Real, threshold: Real, first: State,
    trial: Trial,
) -> tuple[Candidate, State, Items, Callable[[Candidate, Real], State]]:  # fmt: skip
    """What the likeliest face makes of a wrench, and its contact; what each face makes of it, and what
    makes a contact of that.

    The line of action is P(l) = foot + l force. Gradients are finite for every wrench, and 0 where there
    is no line. `first`: any state of the cover.
    """
    o, cover, limits = s.o, s.cover, s.limits
    is_finite = o.isfinite(sum(force) + sum(moment))
    force, moment = o.where(is_finite, (tuple(force), tuple(moment)), (NONE, NONE))
    strength = dot(force, force)
    is_some = strength > 0.0
    strength = o.where(is_some, strength, 1.0)
    size = o.sqrt(strength)
    x, y, z = cross(force, moment)
    foot, spin = (x / strength, y / strength, z / strength), dot(force, moment) / size
    # A line along a face meets it nowhere: rounding must not send the point to infinity.
    least = 1e-9 * size
    none = Candidate(False, 0, NONE, 0.0, NONE, NONE, 0.0, 0.0, inf, False, first)

    def crossing(face: Face, along: Real) -> tuple[Point, Point, Point]:
        """Where the line meets the plane, f(point) = 0. Once the face is pressed in by d, it does so at
        P^e = point + d ahead, and P^i = point + d aside."""
        point = moved(foot, -(face.offset + dot(face.normal, foot)) / along, force)
        ahead = force[0] / along, force[1] / along, force[2] / along
        return point, ahead, moved(ahead, -1.0, face.normal)

    def outside(face: Face, point: Numbers) -> Real:
        edges = zip(face.edge, face.limit, strict=True)
        return o.most(dot(edge, point) - end for edge, end in edges)

    def is_pushed(face: Face) -> Test:
        along = dot(face.normal, force)
        return (along >= threshold) & (along > least) & (face.surface > 0)

    def pressed(face: Face, is_pushed: Test) -> Candidate:
        along = o.where(is_pushed, dot(face.normal, force), 1.0)
        point, ahead, aside = crossing(face, along)
        after, depth, far = trial(face.surface, along, point)
        # d_n depends on the place P^i, and P^i lies aside by d_n tan(angle between F and n). A fixed-point
        # iteration solves this: each round shrinks the error by |grad d_n| tan(angle), which is 0.02 for a
        # frame that sags by 1.5 mm within 60 mm, pushed at 45 degrees, and 0.15 with a threshold's 1.5 of
        # 15 N.
        d, place = 0.0, point
        for _ in range(1 if cover.is_even else s.turns + 1):
            d = cover.displacement(depth, along, face.surface, o.vector(place))
            place = moved(point, d, aside)
        beyond = outside(face, place)
        return Candidate(
            is_pushed, face.surface, tuple(face.normal), along, moved(point, d, ahead), place, d, beyond,
            o.where(beyond <= limits.rounding, 0.0, beyond), far | (d > cover.thickness), after,
        )  # fmt: skip

    def is_within(one: Candidate) -> Test:
        return one.pushed & (one.outside <= o.most((limits.tolerance, limits.rounding)))

    def told(one: Candidate, status: Real) -> State:
        return s.contact(
            o.vector(one.point), o.where(is_within(one), one.surface, 0), one.displacement, status, spin,
            o.vector(one.normal), one.along, one.outside,
        )  # fmt: skip

    def there() -> Real:
        """The status where the best face holds its point."""

        def apart(one: Candidate) -> Test:
            dent = one.displacement + best.displacement + limits.rounding
            return (one.cost <= 0.0) & (square(one.point, best.point) > dent * dent)

        status = o.where(best.far, EXTRAPOLATED, OK)
        status = o.where(o.some(o.each(apart, found)), AMBIGUOUS, status)
        return o.where(abs(spin) > limits.spin * best.along, SECOND_SUPPORT, status)

    def nowhere() -> Real:
        return o.either(size >= threshold, missed, lambda: BELOW_THRESHOLD)

    def missed() -> Real:
        """The status where none does, of a force that is strong enough."""

        def is_real(face: Face) -> Test:
            return face.surface > 0

        def is_faced(face: Face) -> Test:
            return is_real(face) & (dot(face.normal, force) > least)

        def is_pulled(face: Face) -> Test:
            along = dot(face.normal, force)
            pulled = (along <= -threshold) & (along < -least) & is_real(face)

            def meets() -> Test:
                point, _, _ = crossing(face, o.where(pulled, along, 1.0))
                return outside(face, point) <= limits.tolerance

            return o.either(pulled, meets, lambda: False)

        real, faced, pulled = (
            o.some(o.each(test, faces)) for test in (is_real, is_faced, is_pulled)
        )
        status = o.where(best.pushed | o.no(real), MISSED, BELOW_THRESHOLD)
        return o.where(pulled | (real & o.no(faced)), PULLING, status)

    found = o.where_each(faces, is_pushed, pressed, none)
    # The face closest to its point; of several that hold theirs, the one pushed most squarely.
    best = o.first_of_least(found, lambda one: one.cost, lambda one: one.along)
    status = o.either(is_within(best), there, nowhere)
    status = o.where(doubt != OK, doubt, status)
    status = o.where(o.no(is_some) | (size < threshold / 10), NO_CONTACT, status)
    status = o.where(is_finite & (doubt != INVALID), status, INVALID)
    return best, told(best, status), found, told


def touched(
    s: Solver, faces: Items, state: Touch, t: Real, force: Numbers, moment: Numbers, doubt: Real
) -> tuple[Touch, State]:
    """`ContactSolver.step`: the state after a wrench at the time t, and its contact.

    Which face is touched depends on how far each is pressed in, and that on the history of the cover. So
    every face makes a trial of its own normal force; the state of the touched one is kept.
    """
    o, limits, press = s.o, s.limits, s.cover.press

    def usable() -> tuple[Touch, State]:
        virgin = s.cover.init()

        def trial(surface: Real, along: Real, point: Numbers) -> tuple[State, Real, Test]:
            far = square(point, state.place) > limits.same_place * limits.same_place
            late = t - state.time > limits.recovery
            fresh = (surface != state.surface) | (o.no(state.touching) & (far | late))
            return press(o.where(fresh, virgin, state.cover), t, along)

        # Two thresholds: with one, noise at the threshold would end and begin the contact again and again.
        threshold = o.where(state.touching, limits.release, limits.threshold)
        best, contact, *_ = solved(s, faces, force, moment, doubt, threshold, state.cover, trial)
        touching = contact.surface > 0
        # Without contact nothing bears on the place that was touched last: it recovers as its model does.
        cover = o.either(touching, lambda: best.cover, lambda: press(state.cover, t, 0.0 * t)[0])
        here = best.surface, o.vector(best.touched), t
        surface, place, time = o.where(touching, here, (state.surface, state.place, state.time))
        return Touch(touching, surface, place, time, cover, contact), contact

    def held() -> tuple[Touch, State]:
        """A sample that cannot be used leaves everything as it was."""
        return state, state.contact._replace(status=INVALID)

    finite = o.isfinite(t + sum(force) + sum(moment))
    return o.either(finite & (doubt != INVALID), usable, held)
