"""Records of the rigs of which no model is the whole, for `benchmarks.datasets`."""

from typing import Any, NamedTuple

import numpy as np

from hysteresis.internal import ChannelGeometryRig, FoamBlock, force_path
from hysteresis.rigs import ArmorRig
from hysteresis.rigs._foam_block import MIXED_CYCLES

READING_NOISE = 0.05  # mm

SPEEDS = (2.0, 6.0, 20.0)
"""N/s of the machine that presses a skin."""

TURNS = (0.0, 20.0, 8.0, 16.0, 4.0, 12.0, 2.0, 18.0, 0.0)
AXES = ("Fx (N)", "Fy (N)", "Fz (N)", "Mx (N m)", "My (N m)", "Mz (N m)")


class Sheet(NamedTuple):
    """A table: `columns` {header: (values, decimals)}, the rig it is from, and what its card says."""

    columns: dict[str, tuple[np.ndarray, int]]
    rig: Any
    figures: dict[str, str]

    @property
    def rows(self) -> int:
        """How many."""
        return len(next(iter(self.columns.values()))[0])

    def csv(self) -> str:
        """The file's text: UTF-8, comma, decimal point, line feed."""
        cells = [
            [f"{round(float(v), n) + 0.0:.{n}f}" for v in column]
            for column, n in self.columns.values()
        ]
        lines = [",".join(self.columns), *(",".join(row) for row in zip(*cells, strict=True))]
        return "\n".join(lines) + "\n"


def mixed_cycles() -> Sheet:
    """Foam pressed to other forces, at other rates, after other rests in every cycle."""
    block = FoamBlock()
    made = block.mixed_cycles(READING_NOISE, seed=52)
    figures = {
        "seed of the noise": "52",
        "cycles": str(len(MIXED_CYCLES)),
        "peak, rate and rest of each": "; ".join(
            f"{p:g} N, {r:g} N/s, {s:g} s" for p, r, s in MIXED_CYCLES
        ),
        "largest displacement": f"{made.displacement.max():.3f} mm",
    }
    columns = {
        "time (s)": (made.time, 1), "force (N)": (made.force, 3),
        "displacement (mm)": (made.displacement, 3), "cycle": (made.cycle, 0),
    }  # fmt: skip
    return Sheet(columns, block, figures)


def _presses(rng: np.random.Generator, speed: float, dt: float, samples: int) -> np.ndarray:
    """Ramps of one speed: to the upper part of the range and back by turns, now and then to 0 N."""
    times, forces, n = [0.0], [0.0], 0
    while times[-1] < samples * dt:
        n += 1
        force = 0.0 if n % 6 == 0 else rng.uniform(3.5, 7.8) if n % 2 else rng.uniform(0.3, 3.0)
        times.append(times[-1] + abs(force - forces[-1]) / speed)
        forces.append(force)
    return np.interp(dt * np.arange(1, samples + 1), times, forces)


def _skin(
    places: tuple[tuple[int, ...], ...], names: dict[int, str], seed: int, samples: int
) -> Sheet:
    """Sessions from rest, of each set of places at each speed twice; 10 bits."""
    rig, dt = ChannelGeometryRig(seed=seed), 0.05
    rng = np.random.default_rng([seed, 77])
    found: list[np.ndarray] = []
    for session, (pressed, speed) in enumerate(
        (p, v) for p in places for v in SPEEDS for _ in range(2)
    ):
        force = np.zeros((samples, 5))
        for place in pressed:
            force[:, place] = _presses(rng, speed, dt, samples)
        volts = rig.follow(force, dt)
        volts += rig.readout.noise * rng.normal(size=volts.shape)
        step = (rig.readout.high - rig.readout.low) / (2**rig.readout.bits - 1)
        volts = rig.readout.low + step * rig.readout.counts(volts)
        time = dt * np.arange(1, samples + 1)
        label = np.full((samples, 2), [session + 1, speed])
        found.append(np.column_stack([label, time, force[:, list(names)], volts]))
    table = np.concatenate(found)
    headers = ["session", "speed (N/s)", "time (s)", *names.values(), "layer 1 (V)", "layer 2 (V)"]
    decimals = [0, 0, 2, *[3] * len(names), 4, 4]
    columns = {h: (c, n) for h, c, n in zip(headers, table.T, decimals, strict=True)}
    figures = {
        "seed of the specimen": str(seed),
        "sessions": str(6 * len(places)),
        "step of the converter": f"{1e3 * (20.5 / 1023):.1f} mV",
        "largest reading": ", ".join(f"{c.max():.2f} V" for c in table.T[-2:]),
    }
    return Sheet(columns, rig, figures)


def one_place() -> Sheet:
    """Location A pressed by a machine at three speeds."""
    return _skin(((0,),), {0: "force (N)"}, seed=41, samples=500)


def two_places() -> Sheet:
    """Locations B and D, each alone and both at once, at three speeds."""
    places = ((1,), (3,), (1, 3))
    return _skin(places, {1: "force B (N)", 3: "force D (N)"}, seed=42, samples=250)


def _armor() -> ArmorRig:
    return ArmorRig.of_foam(2015)


def armor_presses() -> Sheet:
    """Twenty presses with a gauge at known points, up and down."""
    rig = _armor()
    points, surface = rig.random_points(20, seed=4)
    made = rig.press(points, surface, force_path(TURNS, 2.0), dt=4.0, session=1)
    presses, samples = made.force.shape
    depth = 1e3 * made.displacement + np.random.default_rng(53).normal(
        0, READING_NOISE, made.force.shape
    )
    columns = {
        "press": (np.repeat(np.arange(1, presses + 1), samples), 0),
        "time (s)": (np.tile(made.time, presses), 1),
        **{axis: (made.wrench[..., k].ravel(), 4) for k, axis in enumerate(AXES)},
        "force (N)": (made.force.ravel(), 3),
        **{f"{axis} (m)": (np.repeat(points[:, k], samples), 4) for k, axis in enumerate("xyz")},
        "displacement (mm)": (depth.ravel(), 3),
    }
    figures = {"seed of the rig": "2015", "presses": str(presses), "turns, N": str(list(TURNS))}
    return Sheet(columns, rig, figures)


def armor_wrenches() -> Sheet:
    """A log of the sensor: 45 touches of 15 N, one after the other, with the truth beside them."""
    rig = _armor()
    points, surface = rig.points_of_the_body()
    force = np.append(force_path((0.0, 15.0, 0.0), 1.5), [0.0, 0.0])
    made = rig.press(points, surface, force, dt=3.0, session=5)
    touched = made.force > 1.5
    contact = np.where(touched[..., None], made.contact, np.nan)
    rows = force.size * len(points)
    columns = {
        "time (s)": (3.0 * np.arange(1, rows + 1), 1),
        **{axis: (made.wrench[..., k].ravel(), 4) for k, axis in enumerate(AXES)},
        "true surface": (np.where(touched, surface[:, None], 0).ravel(), 0),
        **{
            f"true {axis} (m)": (np.nan_to_num(contact[..., k]).ravel(), 4)
            for k, axis in enumerate("xyz")
        },
    }
    figures = {
        "seed of the rig": "2015",
        "touches": str(len(points)),
        "force of each": "0 to 15 to 0 N",
    }
    return Sheet(columns, rig, figures)


SHEETS = {
    "sponge-50mm-mixed-cycles": mixed_cycles,
    "skin-one-place": one_place,
    "skin-two-places": two_places,
    "armor-presses": armor_presses,
    "armor-wrenches": armor_wrenches,
}
"""Record by file stem."""
