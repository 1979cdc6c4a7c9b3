"""The experiments of Tsuji et al. (2014) on one virtual rig; the methods that find a contact, the paper's
and ours, by a foam model with memory and a calibration by twenty presses; and what is measured of them."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache, cached_property, lru_cache, partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy
from jaxtyping import Array, Float

from compensate.armor import Armor, Box, Bumps, ContactSolver, Cover, Presses, WristSensor
from compensate.armor._calibration import planned_presses
from compensate.armor._solver import Contact
from hysteresis import AbstractModel, LinearSponge, Record
from hysteresis.rigs import INWARD, ArmorRig, SpongeRig
from hysteresis.rigs._armor import ArmorPresses
from hysteresis.rigs._foam_block import FoamBlock
from hysteresis.rigs._force_sensors import ForceSensor
from hysteresis.rigs._sponge import SpongeCycles, force_path
from identify import fit

from ..armor._calibration import CalibratedArmor, calibrate_armor, choose_presses
from ._frame import Measure, Paper, Say, compared

READING = 0.05
"""mm, standard deviation of one reading of the stage."""

OURS = "ours"

AGED, WORN = 1_000_000, 0.05
"""Added to a rig's seed for its second record, half a year later; the part of the struts that a sponge
loses until then, where it ages."""

PRESSES, CANDIDATES = 20, 200

STAGE = 5e-5
"""m, deviation of one reading of the stage that measures d."""

TURNS = (0.0, 20.0, 4.0, 15.0)
"""N, of the presses that the choice looks at: up, down and up again."""

Block = SpongeRig | FoamBlock
Errors = Float[np.ndarray, " points"]


class Change(NamedTuple):
    """What became of d = K F + b from one record to another of the same protocol."""

    K: float
    """mm/N"""
    K_error: float
    b: float
    """mm"""
    b_error: float
    p: float
    """how often two records of one specimen differ so much"""


class Rig:
    """One virtual laboratory: a sponge on its stage, a soft armour and a rigid one on the same sensor.

    The stage's records carry reading noise; the specimen is the same in all laboratories, as no
    paper says how sponges differ. With `inside` the physics is close to our models, or is one: the sponge
    has stops, the sensor is a matrix with plays, and the frame sags in one smooth bump.
    """

    def __init__(self, seed: int, inside: bool = False):
        self.seed = seed
        make = partial(ArmorRig, sensor=ForceSensor()) if inside else ArmorRig.of_foam
        self.soft, self.rigid = make(seed=seed), make(seed=seed, soft=False)
        self.block = self.soft.cover
        self._errors: dict[str, Errors] = {}

    def width(self, method: "Method") -> float:
        """Of the box of a method, mm."""
        return 2e3 * (self.soft if method.soft else self.rigid).size.dx

    @cached_property
    def fresh(self) -> SpongeCycles:
        """Fig 6: five times 0 to 20 to 0 N."""
        return _read(_five_cycles(self.block), self.seed)

    @cached_property
    def aged(self) -> SpongeCycles:
        """Fig 9: the same test half a year later, of a sponge that does not age."""
        return _read(_five_cycles(self.block), AGED + self.seed)

    @cached_property
    def worn(self) -> SpongeCycles:
        """The same of a sponge that has lost the part `WORN` of its struts meanwhile."""
        assert isinstance(self.block, FoamBlock)
        return _read(_five_cycles(self.block.at_age(WORN)), AGED + self.seed)

    @cached_property
    def to_40(self) -> SpongeCycles:
        """Fig 7: the same test up to 40 N."""
        return _read(_five_cycles(self.block, peak=40.0), self.seed)

    def of_thickness(self, millimetres: float, noise: bool = True) -> SpongeCycles:
        """Fig 10, as it is read or, to judge a shape, without the noise of a reading."""
        exact = _five_cycles(self.block, thickness=millimetres)
        return _read(exact, self.seed) if noise else exact

    @cached_property
    def lines(self) -> dict[str, LinearSponge]:
        """Approximations 1, 2 and 3."""
        found = self.fresh.statistics()
        named = {"1": found.loading, "2": found.both, "3": found.unloading}
        return {name: LinearSponge(K=K, b=b, threshold=1.5) for name, (K, b) in named.items()}

    @cached_property
    def calibrated(self) -> CalibratedArmor:
        """The soft armour as twenty presses at other points calibrate it."""
        return calibrated(self.soft)

    @cached_property
    def surface_1(self) -> ArmorPresses:
        """The 76 points."""
        return self.soft.press(*self.soft.points_of_surface_1())

    @cached_property
    def on_soft(self) -> ArmorPresses:
        """The 45 points of the soft armour: conditions (a) and (b) are computed from one record."""
        return self.soft.press(*self.soft.points_of_the_body(), session=1)

    @cached_property
    def on_rigid(self) -> ArmorPresses:
        """The 45 points of the rigid one: (c)."""
        return self.rigid.press(*self.rigid.points_of_the_body(), session=1)


@lru_cache
def _five_cycles(block: Block, thickness: float = 50.0, peak: float = 20.0) -> SpongeCycles:
    """Without noise, and once for all rigs."""
    return replace(block, thickness_mm=thickness).five_cycles(peak=peak)


def _read(cycles: SpongeCycles, seed: int) -> SpongeCycles:
    noise = np.random.default_rng(seed).normal(0.0, READING, cycles.force.size)
    return cycles._replace(displacement=cycles.displacement + noise)


def calibrated(rig: ArmorRig) -> CalibratedArmor:
    """The armor of one rig, after presses at the chosen points and a look at what they leave."""
    full = np.repeat([rig.sensor.full_scale_n, rig.sensor.full_scale_nm], 3)
    return calibrate_armor(nominal(rig), twenty_presses(rig), seed=rig.seed, full_scale=full)


def twenty_presses(rig: ArmorRig) -> Presses:
    """What a person with a gauge records at the chosen points."""
    made = rig.calibrate(*chosen_points())
    noise = np.random.default_rng([rig.seed, 7]).normal(0, STAGE, made.displacement.shape)
    depth, normal = made.displacement + noise, INWARD[made.surface - 1]
    return Presses(made.time, made.wrench, made.force, normal, made.touched, made.surface, depth)


def nominal(rig: ArmorRig) -> Armor:
    """What is known before any calibration: the drawing and the foam."""
    box = Box(*rig.size)
    frame = Bumps(box.centres(), 0.0, 0.25 * rig.size.dx)
    cover = Cover(foam(rig.cover), factor=1.0, compliance=frame)
    return Armor(WristSensor(), ContactSolver(box, cover))


@cache
def foam(block: Block) -> AbstractModel:
    """A Preisach model of the foam's first touch, from eight blocks pressed up and down at random."""
    random = np.random.default_rng(2014)
    parts = []
    for label in "01234567":
        turns = random.uniform(0, 7, random.integers(4, 9))
        turns[::2] += 13
        path = force_path((0.0, 0.0, *turns), 0.5)
        depth = block.follow(path, dt=1.0) + random.normal(0, 1e3 * STAGE, len(path))
        parts.append((path, depth, np.arange(1.0 * len(path)), [label] * len(path)))
    columns = map(np.concatenate, zip(*parts, strict=True))
    record = Record.from_arrays(*columns, input_unit="N", output_unit="mm")
    return fit(record, "Preisach").model


@cache
def chosen_points() -> tuple[Float[np.ndarray, "presses 3"], np.ndarray]:
    """Twenty places, after which contacts anywhere on the body are known best, and their surfaces."""
    rig = ArmorRig(seed=0)  # of which the size alone is used
    points, surface = rig.random_points(CANDIDATES, seed=1)
    points = np.concatenate([points, np.asarray(Box(*rig.size).centres())])
    surface = np.append(surface, np.arange(1, 6))
    armor, path = nominal(rig), force_path(TURNS, 2.0)

    def planned(points: np.ndarray, surface: np.ndarray) -> Presses:
        force = np.tile(path, (len(points), 1))
        time = 2.0 * np.arange(1, len(path) + 1)
        return planned_presses(armor, time, force, INWARD[surface - 1], points, surface)

    goals = planned(*rig.random_points(60, seed=2))
    choice = choose_presses(armor, planned(points, surface), goals, PRESSES)
    return points[choice.chosen], surface[choice.chosen]


Locate = Callable[[Rig, ArmorPresses], Float[np.ndarray, "presses 3"]]
"""P^e in m of every press of a record."""


class Method(NamedTuple):
    """A way to find the contact from the wrench."""

    label: str
    soft: bool
    locate: Locate


def solving(solver: Callable[[Rig], ContactSolver]) -> Locate:
    """By the wrench at the end of each press."""

    def locate(rig: Rig, presses: ArmorPresses) -> Float[np.ndarray, "presses 3"]:
        F, M = np.split(presses.wrench[:, -1], 2, axis=1)
        return np.asarray(solver(rig).solve(F, M).point)

    return locate


def following(armor: Callable[[Rig], CalibratedArmor]) -> Locate:
    """By every press as a stream of readings, with the history of sensor and cover."""
    return lambda rig, presses: np.asarray(_followed(armor(rig), presses).point)[:, -1]


def _followed(calibrated: CalibratedArmor, presses: ArmorPresses) -> Contact:
    return _follow(calibrated.armor, jnp.asarray(presses.time), jnp.asarray(presses.wrench))


@eqx.filter_jit
def _follow(armor: Armor, time: Array, readings: Array) -> Contact:
    return jax.vmap(lambda readings: armor.simulate(time, readings))(readings)


METHODS = {
    "a": Method("soft, uncompensated", True, solving(lambda rig: ContactSolver(Box(*rig.soft.size)))),
    "b": Method(
        "soft, approximation 2", True,
        solving(lambda rig: ContactSolver(Box(*rig.soft.size), rig.lines["2"])),
    ),
    "c": Method("rigid", False, solving(lambda rig: ContactSolver(Box(*rig.rigid.size)))),
    OURS: Method("soft, calibrated, with memory", True, following(lambda rig: rig.calibrated)),
}  # fmt: skip
"""The conditions of fig 14, and ours; a new method is one more entry."""


def body_errors(rig: Rig, method: Method) -> Errors:
    """Distances in mm between the contact found and the true one, at the 45 points; found once."""
    if method.label not in rig._errors:
        presses = rig.on_soft if method.soft else rig.on_rigid
        off = method.locate(rig, presses) - presses.contact[:, -1]
        rig._errors[method.label] = 1e3 * np.linalg.norm(off, axis=1)
    return rig._errors[method.label]


def surface_errors(rig: Rig, name: str) -> Errors:
    """Errors in z in mm at the 76 points, by a line over the gauge's force, or ours from the readings."""
    presses = rig.surface_1
    if name == OURS:
        found = 1e3 * np.asarray(_followed(rig.calibrated, presses).displacement)[:, -1]
    else:
        found = np.asarray(rig.lines[name].simulate(None, presses.force[:, -1]))
    return np.abs(found - 1e3 * presses.displacement[:, -1])


def linear_range(cycles: SpongeCycles) -> float:
    """N, up to where a line through the means from 2 to 20 N describes a record over all cycles and both
    branches (fig 7): the mean leaves it by no more than the record's own scatter."""
    force = np.unique(cycles.force)
    at = [cycles.displacement[cycles.force == f] for f in force]
    mean, sd = np.array([d.mean() for d in at]), np.array([d.std(ddof=1) for d in at])
    used = (force >= 2) & (force <= 20)
    line = np.polyval(np.polyfit(force[used], mean[used], 1), force)
    beyond = np.abs(mean - line) - sd
    n = next((n for n in range(1, len(force)) if force[n] > 20 and beyond[n] > 0), None)
    if n is None:
        return float(force[-1])
    part = beyond[n - 1] / (beyond[n - 1] - beyond[n])
    return float(force[n - 1] + part * (force[n] - force[n - 1]))


def changed(before: SpongeCycles, after: SpongeCycles) -> Change:
    """A line through the differences of two records, sample by sample.

    Sample for sample the foam's own curve cancels, which no line follows, and what is left is independent
    reading noise: F(2, n - 2) = (squares that the line explains / 2) / (squares left / (n - 2)).
    """
    used = before.force >= 2
    force, difference = before.force[used], (after.displacement - before.displacement)[used]
    line = scipy.stats.linregress(force, difference)
    explained = line.slope * force + line.intercept
    freedom = len(force) - 2
    variance = np.sum((difference - explained) ** 2) / freedom
    p = scipy.stats.f.sf(np.sum(explained**2) / 2 / variance, 2, freedom)
    found = (line.slope, line.stderr, line.intercept, line.intercept_stderr, p)
    return Change(*map(float, found))


def nonlinearity(cycles: SpongeCycles) -> float:
    """Per cent: the largest distance of the first loading from its line, over its range, 2 to 20 N."""
    first = slice(1, int(np.argmax(cycles.force)) + 1)
    force, d = cycles.force[first], cycles.displacement[first]
    off = d - np.polyval(np.polyfit(force, d, 1), force)
    return float(100 * np.max(np.abs(off)) / np.ptp(d))


STRONGLY = 1.5
"""Times the nonlinearity of the others from which that of a thin sponge is seen in a figure."""
MIDDLE = np.array([10, 29, 48, 67]) - 1
"""Rows of the 76 points that lie in the middle of the surface."""


def _sponge(read: Any) -> Measure:
    return lambda rig, _: float(read(rig.fresh.statistics()))


def _body(method: str) -> Measure:
    return lambda rig, ours: float(np.mean(body_errors(rig, METHODS[OURS if ours else method])))


def _surface(name: str) -> Measure:
    return lambda rig, ours: float(np.mean(surface_errors(rig, OURS if ours else name)))


def _largest(rig: Rig, ours: bool) -> float:
    return max(float(np.max(surface_errors(rig, k))) for k in ((OURS,) if ours else "123"))


PAPER = Paper("tsuji2014", {
    "mean_gap": _sponge(lambda s: s.mean_gap),
    "largest_gap": _sponge(lambda s: s.largest_gap),
    "largest_gap_force": _sponge(lambda s: s.largest_gap_force),
    "largest_gap_test": _sponge(lambda s: s.largest_gap_cycle),
    "linear_limit": lambda rig, _: linear_range(rig.to_40),
    "aged_K": lambda rig, _: rig.aged.statistics().both.K,
    "aged_b": lambda rig, _: rig.aged.statistics().both.b,
    **{f"error_{k}": _surface(k) for k in "123"},
    "error_largest": _largest,
    **{f"body_{k}": _body(k) for k in "abc"},
})  # fmt: skip


def carry_out(rigs: int, *, seed: int, ours: bool, say: Say, **_: Any) -> dict[str, Any]:
    """Every number over all rigs, with spread."""
    made = [Rig(seed + n) for n in range(rigs)]
    if ours:
        say("each is also calibrated by twenty presses (--no-ours leaves that out)")

    def progress(done: int) -> None:
        if done % 10 == 0 or done == rigs:
            say(f"rig {done} of {rigs}")

    return {
        "rig": PAPER.said["rig"],
        "rows": compared(PAPER.published, made, ours, progress),
        "findings": _findings(made),
    }


def _findings(rigs: Sequence[Rig]) -> list[dict[str, Any]]:
    """What the paper says in words, and whether the sentence is true of every or the mean rig."""
    count = len(rigs)
    changes = [changed(rig.fresh, rig.aged) for rig in rigs]
    seen = sum(change.p < 0.05 for change in changes)
    told = sum(changed(rig.fresh, rig.worn).p < 0.05 for rig in rigs)
    K, b = (2 * float(np.mean([getattr(c, f) for c in changes])) for f in ("K_error", "b_error"))
    bent = {h: nonlinearity(rigs[0].of_thickness(h, noise=False)) for h in (50.0, 30.0, 10.0)}
    errors = [[float(np.mean(surface_errors(rig, k))) for k in "123"] for rig in rigs]
    first, averages = [np.argmin(row) == 0 for row in errors], np.mean(errors, axis=0)
    around = np.array([surface_errors(rig, "1") for rig in rigs])
    middle, rest = around[:, MIDDLE].mean(1), np.delete(around, MIDDLE, axis=1).mean(1)
    more = middle - rest
    chance = float(np.std(more, ddof=1) / np.sqrt(count)) if count > 1 else np.inf
    largest = np.array([_largest(rig, False) for rig in rigs])
    part = {
        k: 100 * float(np.mean([body_errors(rig, METHODS[k]) for rig in rigs])) / rigs[0].width(METHODS[k])
        for k in "abc"
    }  # fmt: skip
    true = {
        "aging": seen <= 0.05 * count + 2 * np.sqrt(0.05 * 0.95 * count) and told == count,
        "thickness": bent[10.0] > STRONGLY * max(bent[50.0], bent[30.0]),
        "approximation": all(first),
        "middle": more.mean() > 2 * chance,
        "largest": np.max(averages) < 5 and largest.mean() <= 10,
        "relative": abs(part["b"] - part["c"]) < 0.25 * (part["a"] - part["c"]),
    }
    return PAPER.findings(
        true, False, count=count, seen=seen, told=told, lost=100 * WORN, K=K, b_mm=b,
        by_chance=0.05 * count,
        bent=", ".join(f"{x:.2f} % at {h:g} mm" for h, x in bent.items()), strongly=STRONGLY,
        first=sum(first), middle=middle.mean(), rest=rest.mean(), more=more.mean(), chance=chance,
        averages=", ".join(f"{x:.1f}" for x in averages), below=sum(max(row) < 5 for row in errors),
        largest=largest.mean(), up_to_10=sum(largest <= 10), **part,
    )  # fmt: skip
