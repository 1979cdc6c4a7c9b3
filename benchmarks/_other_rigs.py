"""Virtual rigs of kinds that no model here contains, each a plain loop over time.

Their held-out cycles have amplitudes and rates of their own. What is known of them exactly lets verdicts be
compared with what a fit is worth.
"""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

import identify
from hysteresis import Record

from ._accuracy.verdicts import Judged, is_beaten
from ._measure import Row, judged

NOISE = 0.002
"""Standard deviation of the reading, of the output's range."""

STEP = 0.02
"""Sampling step."""

VIRTUAL = "virtual rigs, error over the best baseline's"
"""What `--only` has to be part of for these rows."""

WORST = 1.05
"""Times the rms error of the best baseline."""

Samples = Float[np.ndarray, " samples"]


class Rig(NamedTuple):
    """From times and inputs to an output.

    - `swings`: (from, to) of each cycle, the last `tested` held out; `rows` of each cycle.
    """

    output: Callable[[Samples, Samples], Samples]
    swings: tuple[tuple[float, float], ...]
    tested: int = 2
    rows: tuple[int, ...] = (120,)


def motion(rig: Rig) -> Samples:
    """Triangles between the ends of each swing, one after the other."""
    parts, at = [], rig.swings[0][0]
    for k, (low, high) in enumerate(rig.swings):
        half = rig.rows[k % len(rig.rows)] // 2
        rise = np.linspace(0, 1, half, endpoint=False)
        parts += [at + (high - at) * rise, high + (low - high) * rise]
        at = low
    return np.concatenate(parts)


def record_of(rig: Rig, seed: int = 0) -> Record:
    """The rig's readings, with noise."""
    return reading_of(rig, motion(rig), seed)


def reading_of(rig: Rig, u: Samples, seed: int) -> Record:
    """What the rig reads at these inputs, with noise."""
    t = STEP * np.arange(len(u))
    y = rig.output(t, u)
    noisy = y + NOISE * np.ptp(y) * np.random.default_rng(seed).normal(size=len(y))
    return Record.from_arrays(u, noisy, t)


def magnetisation(u: Samples) -> Samples:
    """Walls that are pinned on their way to the anhysteretic curve (Jiles and Atherton, 1986).

    dM = (1 - c) dM_irr + c dM_an,  dM_irr / dH = (M_an - M_irr) / (k sign(dH) - a (M_an - M_irr))
    """
    shape, pinning, coupling, bent = 0.18, 0.25, 0.1, 0.15
    stuck, whole, found, before = -0.95, -0.95, [], u[0]
    for field in u:
        steps = 20
        for _ in range(steps):
            dh = (field - before) / steps
            x = (before + coupling * whole) / shape
            free = 1 / np.tanh(x) - 1 / x if abs(x) > 1e-3 else x / 3
            away = free - stuck
            if away * dh > 0:
                stuck += away / (pinning * np.sign(dh) - coupling * away) * dh
            whole = (1 - bent) * stuck + bent * free
            before += dh
        before = field
        found.append(whole)
    return np.array(found)


def polarisation(t: Samples, u: Samples) -> Samples:
    """Domains of many coercive fields, each turned at a rate that grows with the field over its own."""
    coercive = np.linspace(0.15, 0.65, 25)
    p, found = -np.ones(25), []
    for field in u:
        for _ in range(4):
            felt = np.clip(field / coercive, -1.5, 1.5)
            p += STEP / 4 * 8 * np.abs(felt) ** 9 * (np.sign(felt) - p)
            p = np.clip(p, -1, 1)
        found.append(p.mean() + 0.1 * field)
    return np.array(found)


def magnetostriction(t: Samples, u: Samples) -> Samples:
    """Strain of a rod: even in its magnetisation, and not quite a square."""
    m = magnetisation(u)
    return m**2 - 0.3 * m**4


def piezo_strain(t: Samples, u: Samples) -> Samples:
    """Strain of a ferroelectric: even in the polarisation, and the field times it."""
    p = polarisation(t, u)
    return p**2 + 0.3 * p * u


def _behind_a_gear(u: Samples, spring: float, friction: float) -> tuple[list[float], list[float]]:
    """Torque behind a worn gear, and the angle of its load: backlash, compliance, friction, a spring."""
    load, torques, angles = 0.0, [], []
    for motor in u:
        for _ in range(20):
            gap = motor - load
            torque = 8 * (gap - np.clip(gap, -0.08, 0.08))
            net = torque - spring * load
            load += 0.05 * (net - np.clip(net, -friction, friction))
        torques.append(torque)
        angles.append(load)
    return torques, angles


def geared_drive(t: Samples, u: Samples) -> Samples:
    """Torque behind a gear with backlash, of a shaft that drives a load with friction and a spring."""
    return np.array(_behind_a_gear(u, 1.5, 0.35)[0])


def load_angle(t: Samples, u: Samples) -> Samples:
    """Angle of the load behind a worn gear."""
    return np.array(_behind_a_gear(u, 0.8, 0.25)[1])


def fractional_dashpot(t: Samples, u: Samples) -> Samples:
    """A spring beside a springpot of order 0.35, by Gruenwald's sum over the whole history."""
    order = 0.35
    g = np.cumprod(np.append(1.0, 1 - (1 + order) / np.arange(1, len(u))))
    return 0.4 * u + np.convolve(g, u)[: len(u)] / STEP**order


def sheath(t: Samples, u: Samples) -> Samples:
    """Tension at the far end of a tendon in a curved sheath, pulled at the near end: 30 capstans."""
    n, mu = 30, 0.03
    x, found = np.zeros(n + 1), []
    stiffness = 40.0
    for pull in u:
        x[0] = pull + 0.1
        for _ in range(60):
            tension = np.maximum(stiffness * n * (x[:-1] - x[1:]) / 10, 0.0)
            after = np.append(tension[1:], 3 * x[-1])
            net = tension - after
            hold = mu * np.maximum(tension, after)
            x[1:] += 0.004 * (net - np.clip(net, -hold, hold))
        found.append(3 * x[-1])
    return np.array(found)


def wire_rope(t: Samples, u: Samples) -> Samples:
    """Wire-rope isolator: strands slip over each other, and the rope stiffens in tension."""
    z, found, before = 0.0, [], u[0]
    for x in u:
        for _ in range(10):
            dx = (x - before) / 10
            z += dx * (9 - abs(z) ** 1.4 * (5.5 + 3.5 * np.sign(dx * z)))
        before = x
        found.append(z * np.exp(0.9 * x) + 1.2 * x + 1.5 * max(x, 0) ** 3)
    return np.array(found)


def muscle(t: Samples, u: Samples) -> Samples:
    """Contraction of a pneumatic muscle over pressure: braid friction, creep of the tube, a soft limit."""
    braid, tube, found = 0.0, 0.0, []
    for pressure in u:
        free = np.tanh(1.3 * max(pressure - 0.1, 0.0))
        for _ in range(5):
            net = 3 * (free - braid) - 0.15 * (0.3 + pressure) * np.sign(free - braid)
            if abs(3 * (free - braid)) > 0.15 * (0.3 + pressure):
                braid += 0.1 * net
        tube += 0.01 * (braid - tube)
        found.append(braid + 0.15 * tube)
    return np.array(found)


def warming_gauge(t: Samples, u: Samples) -> Samples:
    """A load cell with a small loop, whose zero drifts as its housing warms up."""
    seat, found = 0.0, []
    for force, now in zip(u, t, strict=True):
        seat = np.clip(seat, force - 0.08, force + 0.08)
        found.append(force + 0.3 * seat + 0.5 * (1 - np.exp(-now / 12)))
    return np.array(found)


def wood_joint(t: Samples, u: Samples) -> Samples:
    """A nailed joint: nails yield and crush their holes; branches are pinched, and lose strength."""
    plastic, hole, lost, found, before = 0.0, 0.0, 0.0, [], u[0]
    for x in u:
        hole = max(hole, abs(plastic))
        bearing = 6 * (x - plastic)
        weak = 1 / (1 + 0.15 * lost)
        limit = weak * (0.35 + 0.65 * np.clip((abs(x) - 0.7 * hole) / 0.15, 0, 1))
        force = np.clip(bearing, -limit, limit)
        plastic = x - force / 6
        lost += abs(force * (x - before))
        before = x
        found.append(force + 0.2 * x)
    return np.array(found)


def bristles(t: Samples, u: Samples) -> Samples:
    """A slide with bristles that bend before it slides (LuGre), weaker at speed."""
    z, found, before = 0.0, [], u[0]
    for x in u:
        for _ in range(20):
            v = (x - before) / STEP
            level = (0.6 + 0.4 * np.exp(-((v / 0.4) ** 2))) / 40
            rate = v - abs(v) / level * z
            z += STEP / 20 * rate
        before = x
        found.append(40 * z + 0.3 * v)
    return np.array(found)


def sticking_valve(t: Samples, u: Samples) -> Samples:
    """Stem of a control valve over its signal: it sticks within a band, then jumps."""
    stem, found = 0.0, []
    for signal in u:
        if abs(signal - stem) > 0.12:
            stem = signal - 0.05 * np.sign(signal - stem)
        found.append(stem)
    return np.array(found)


def capacitance(t: Samples, u: Samples) -> Samples:
    """Small-signal capacitance of a ferroelectric: a peak on each branch, where domains can turn."""
    return 1 / (0.3 + polarisation(t, u) ** 2)


def encoder(t: Samples, u: Samples) -> Samples:
    """Counts of an encoder behind a backlash."""
    angle, found = u[0], []
    for motor in u:
        angle = np.clip(angle, motor - 0.07, motor + 0.07)
        found.append(np.round(45 * angle))
    return np.array(found)


def velostat(t: Samples, u: Samples) -> Samples:
    """Resistance of a carbon-filled foil under pressure, whose contacts creep closer."""
    times, share = np.array([0.2, 2.0, 20.0]), np.array([0.03, 0.08, 0.1])
    crept, found = np.zeros(3), []
    for pressure in 60 * u:
        crept += -np.expm1(-STEP / times) * (pressure - crept)
        found.append(0.6 + 12 / (1 + 0.5 * pressure + share @ crept))
    return np.array(found)


def stretched_conductor(t: Samples, u: Samples) -> Samples:
    """Resistance of a carbon-filled rubber band: speed of either sign opens cracks that close slowly."""
    cracks, rest, found, before = 0.0, 0.0, [], u[0]
    for strain in u:
        cracks += STEP / 0.6 * (abs(strain - before) / STEP - cracks)
        rest += STEP / 3 * (strain - rest)
        before = strain
        found.append(3.6 * strain + 3.6 * strain**2 + 3.75 * cracks - 1.8 * rest)
    return np.array(found)


def elastomer_actuator(t: Samples, u: Samples) -> Samples:
    """Strain of a dielectric elastomer over its voltage: a squared field, and creep over decades."""
    times = np.geomspace(0.06, 40, 9)
    crept, found = np.zeros(9), []
    for field in 5.5 * u:
        pressure = field**2 * (1 + 0.01 * field**2)
        crept += -np.expm1(-STEP / times) * (pressure - crept)
        found.append(0.35 * pressure + 0.09 * crept.sum())
    return np.array(found)


def memory_wire(t: Samples, u: Samples) -> Samples:
    """Strain of a shape-memory wire over temperature: grains that change at their own temperatures."""
    rng = np.random.default_rng(3)
    at, half = rng.normal(0.6, 0.07, 150), np.abs(rng.normal(0.1, 0.03, 150))
    martensite, found = np.ones(150), []
    for heat in u:
        martensite[heat > at + half] = 0.0
        martensite[heat < at - half] = 1.0
        found.append(4.2 * martensite.mean() + 0.14 * heat)
    return np.array(found)


def cell_voltage(t: Samples, u: Samples) -> Samples:
    """Voltage of a battery cell over its state of charge, with one state of hysteresis and diffusion."""
    state, slow, found, before = -1.0, 0.0, [], u[0]
    for charge in u:
        current, before = (charge - before) / STEP, charge
        state += abs(current) * STEP * 12 * (np.sign(current) - state)
        slow += STEP / 0.2 * (0.02 * current - slow)
        steep = -0.08 * np.exp(-20 * charge) + 0.05 * np.tanh((charge - 0.55) / 0.06)
        found.append(0.35 * charge + steep + 0.018 * state + 0.01 * current + slow)
    return np.array(found)


def leaking_charge(t: Samples, u: Samples) -> Samples:
    """Voltage of a piezoelectric force sensor, zeroed under its preload, whose amplifier's charge leaks."""
    y = np.zeros(len(u))
    for k in range(1, len(u)):
        y[k] = y[k - 1] * np.exp(-STEP / 1.5) + (u[k] - u[k - 1]) * (1 + 0.2 * u[k])
    return y


def magnetorheological_damper(t: Samples, u: Samples) -> Samples:
    """Force of a damper over its stroke: Bouc-Wen, viscous, a spring (Spencer and others, 1997)."""
    v, z, steps = np.gradient(u, STEP), 0.0, 8
    y = np.empty(len(u))
    for k in range(len(u)):
        for _ in range(steps):
            z += STEP / steps * (30 * v[k] - 20 * abs(v[k]) * abs(z) * z - 10 * v[k] * z * z)
        y[k] = 0.6 * z + 0.15 * v[k] + 0.2 * u[k]
    return y


AMPLITUDES = (1.0, 0.6, 0.9, 0.45, 0.75, 1.0, 0.85, 0.55)
BOTH = tuple((-a, a) for a in AMPLITUDES)
ONE = tuple((0.0, a) for a in AMPLITUDES)
FROM_HALF = ((0.5, 1.0), *((0.5 - a / 2, 0.5 + a / 2) for a in AMPLITUDES[1:]))
"""From the middle of the range, where the sample has rested."""
FROM_ZERO = ((0.0, 1.0), *BOTH[1:])
LARGE = tuple((-a, a) for a in (1.0, 0.95, 1.0, 0.9, 0.98, 1.0, 0.93, 0.97))
GROWING = tuple((-a, a) for a in (0.2, 0.3, 0.3, 0.45, 0.45, 0.6, 0.6, 0.6))
CHARGES = ((0.1, 0.95), (0.3, 0.8), (0.2, 0.9), (0.5, 0.7), (0.1, 0.6), (0.4, 0.95), (0.25, 0.75))
RIGS = {
    "magnetostriction": Rig(magnetostriction, BOTH),
    "piezo strain": Rig(piezo_strain, BOTH, rows=(120, 200)),
    "capacitance": Rig(capacitance, LARGE),
    "geared drive, torque": Rig(geared_drive, BOTH),
    "geared drive, angle": Rig(load_angle, BOTH),
    "fractional dashpot": Rig(fractional_dashpot, ONE, rows=(120, 240, 60)),
    "tendon sheath": Rig(sheath, ONE),
    "wire rope": Rig(wire_rope, BOTH),
    "pneumatic muscle": Rig(muscle, ONE, rows=(120, 200, 80)),
    "warming load cell": Rig(warming_gauge, ONE),
    "nailed joint": Rig(wood_joint, GROWING),
    "slide with bristles": Rig(bristles, BOTH, rows=(120, 60, 200)),
    "sticking valve": Rig(sticking_valve, ONE),
    "encoder behind a backlash": Rig(encoder, BOTH, rows=(120, 80, 200)),
    "velostat": Rig(velostat, ONE, rows=(120, 70, 200)),
    "stretched conductor": Rig(stretched_conductor, ONE, rows=(100, 60, 180)),
    "elastomer actuator": Rig(elastomer_actuator, ONE, rows=(150, 80, 300)),
    "shape-memory wire": Rig(memory_wire, ONE, rows=(160, 120, 90)),
    "leaking charge": Rig(leaking_charge, FROM_HALF, rows=(120, 80, 200)),
    "magnetorheological damper": Rig(magnetorheological_damper, FROM_ZERO, rows=(160, 100)),
    "battery cell": Rig(cell_voltage, CHARGES, rows=(160, 80)),
}


def rows() -> Iterator[tuple[Row, Judged]]:
    """Held-out error of each rig over that of the best baseline, and its verdict beside it."""
    for name, rig in RIGS.items():
        fit = identify.fit(record_of(rig), test_cycles=rig.tested)
        one = judged_fit(f"virtual {name}", fit)
        beside = f"{fit.name} {one.error:.2g} %; {one.baseline} {one.other:.2g} %; {one.level}"
        yield judged(f"{VIRTUAL}: {name} ({beside})", one.error / one.other, WORST), one


def judged_fit(what: str, fit: identify.FitResult) -> Judged:
    """A fit beside its baselines, all on its test rows."""
    test, ours = fit.metrics["test"], fit.test_blocks
    assert test is not None
    assert ours is not None
    best = min(fit.baselines, key=lambda one: one.judged[0])
    theirs = [one.test_blocks for one in fit.baselines if one.test_blocks is not None]
    level, beaten = fit.verdict.level, is_beaten(ours, theirs)
    return Judged(what, level, test.nrmse_percent, best.name, best.judged[1], beaten)
