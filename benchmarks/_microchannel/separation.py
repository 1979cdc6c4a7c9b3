"""Two places pressed at once, their signals separated by independent components: where that helps.

Two layers read z = G s, s the signals of the two places. The unmixing is that of gains known from single
presses, or FastICA's, or `gains_in_use`; force is then found from each signal by the same network. Beside
them the filter that needs no unmixing.
"""

import warnings
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from compensate.internal import ForceEstimator, MultiContactEstimator, gains_in_use
from hysid.reproduction._skin import FORCE, HIGH_N, NOISE_V, off_of, rms, train_staircase
from hysid.reproduction._skin_paper import train_channels
from hysid.soft_sensor._force_records import ForceRecord
from hysteresis import InputError
from hysteresis.rigs import MicrochannelRig

from .._measure import Row, means, noted

DT = 0.05
SAMPLES, LENGTH = 6000, (60, 120)
"""Of a record, and of a press."""

SIGNAL = {"thresholds": (0.1, 0.2, 0.4, 0.8), "lags": (0.06, 0.12, 0.25, 1.0, 5.0)}
CONTRAST = "cube"
"""Of FastICA: the better of its three on the sensors of seeds 50 to 53, as all settings here."""

Gains = Float[np.ndarray, "2 2"]
Readings = Float[np.ndarray, "samples 2"]


class Case(NamedTuple):
    """How two places are pressed: `rest` is the part of the time that each is not."""

    places: tuple[int, int] = (1, 3)
    rest: float = 0.9
    finger: bool = False
    in_phase: bool = False
    other: bool = False
    """Gains and networks are another specimen's."""


CASES = {
    "a machine, each a tenth of the time": Case(),
    "a machine, each four tenths of the time": Case(rest=0.6),
    "a finger, each a tenth of the time": Case(finger=True),
    "a finger, each four tenths of the time": Case(rest=0.6, finger=True),
    "a machine, both in phase": Case(in_phase=True),
    "a machine on B and C, 11 degrees apart": Case(places=(1, 2)),
    "a machine on another specimen than taught": Case(other=True),
}


class Taught(NamedTuple):
    """What a machine's presses of one place at a time taught."""

    gains: Gains
    """One column for each place; signals are in their unit."""
    signal_to_force: tuple[ForceEstimator, ForceEstimator]
    filter: MultiContactEstimator


def separation_rows(quick: bool) -> list[Row]:
    """Force RMSE of every way of separating, while a place is pressed."""
    try:
        import sklearn.decomposition  # noqa: F401
    except ImportError:
        what = "(D) two places, FastICA"
        return [noted(what, float("nan"), reason="pip install scikit-learn to measure it")]
    rows = []
    for name, case in CASES.items():
        found = [_one(case, seed, quick) for seed in (range(1) if quick else range(3))]
        mean = means(found)
        rows += [
            noted(f"(D) {name}: FastICA, RMSE, N", mean["independent"]),
            noted("    its columns' directions are off, degrees", mean["independent_off"]),
            noted("    gains of single presses, RMSE, N", mean["known"]),
            _refused("    gains in use, RMSE, N", mean["alone"]),
            _refused("    their directions are off, degrees", mean["alone_off"]),
            noted("    the filter, gains of single presses, RMSE, N", mean["filter"]),
            _refused("    the filter, gains in use, RMSE, N", mean["regained"]),
        ]
    return rows


def _refused(what: str, value: float) -> Row:
    return noted(
        what,
        value,
        reason="refused: no place is pressed alone" if np.isnan(value) else "no bar is set",
    )


def _one(case: Case, seed: int, quick: bool) -> dict[str, float]:
    fabrication = 0.15 if case.other else 0.0
    rig = MicrochannelRig(seed=seed, fabrication=fabrication)
    taught = teach(seed, fabrication, case.places, 100 if quick else 400)
    pressed = MicrochannelRig(seed=seed + 1000, fabrication=fabrication) if case.other else rig
    figures: dict[str, list[float]] = {}
    for session in range(1 if quick else 2):
        t, force, z = press(pressed, case, session)
        used = (force > 0).any(1)
        true = pressed.gains[:, case.places]
        for name, way in WAYS.items():
            gains = way(z, taught.gains)
            if gains is None:
                off, turned = np.full_like(force, np.nan), np.nan
            else:
                off, turned = _separated(taught, gains, t, z) - force, _degrees(gains, true)
            figures.setdefault(name, []).append(rms([off[used]]))
            figures.setdefault(f"{name}_off", []).append(turned)
        if gains is not None:
            regained = eqx.tree_at(lambda one: one.sensor.gains, taught.filter, jnp.asarray(gains))
            off = np.asarray(regained.simulate(t, z).value) - force
        figures.setdefault("regained", []).append(rms([off[used]]))
        off = np.asarray(taught.filter.simulate(t, z).value) - force
        figures.setdefault("filter", []).append(rms([off[used]]))
    return {name: float(np.mean(values)) for name, values in figures.items()}


@cache
def teach(seed: int, fabrication: float, places: tuple[int, int], epochs: int) -> Taught:
    """Gains, a network from each signal to its force, and the filter, all from single presses."""
    rig = MicrochannelRig(seed=seed, fabrication=fabrication)
    records = [
        [rig.cnc_loops(396, location=k, dt=DT, session=10 * k + n) for n in range(10)]
        for k in places
    ]
    single = [
        [ForceRecord(one.time, one.reading, one.force[:, k]) for one in found]
        for k, found in zip(places, records, strict=True)
    ]
    whole = train_channels(single, **FORCE, high_force=HIGH_N, noise=NOISE_V, epochs=epochs)
    sensor: Any = whole.sensor
    gains = np.asarray(sensor.gains)
    estimators = []
    for g, found in zip(gains.T, single, strict=True):
        learnt = train_staircase(
            [one.time for one in found], [one.reading @ g / (g @ g) for one in found],
            [one.force for one in found], **SIGNAL, epochs=epochs,
        )  # fmt: skip
        estimators.append(ForceEstimator(learnt.module, off_of(learnt), HIGH_N))
    return Taught(gains, tuple(estimators), whole)


def press(
    rig: MicrochannelRig, case: Case, session: int
) -> tuple[np.ndarray, Float[np.ndarray, "samples 2"], Readings]:
    """Time, forces on the two places, readings: presses at random times, half sines to 1.5 to 7 N."""
    random = np.random.default_rng([rig.seed, 13, session])
    force, place = np.zeros((SAMPLES, rig.gains.shape[1])), np.ones((SAMPLES, *rig.gains.shape))
    for k in case.places:
        for begin, length in _times(random, case.rest):
            at = slice(begin, begin + length)
            force[at, k] = random.uniform(1.5, 7.0) * _half_sine(length)
            if case.finger:
                common = rig.placement_common * random.normal()
                apart = rig.placement_differential * random.normal()
                place[at, :, k] = np.exp(common + apart * np.array([1.0, -1.0]))
    if case.in_phase:
        # The second finger does what the first does, from press to press by 0.6 to 1.4 times as much.
        first, second = case.places
        begins = np.cumsum(np.diff(force[:, first] > 0, prepend=False) & (force[:, first] > 0))
        times = random.uniform(0.6, 1.4, begins.max() + 1)
        force[:, second] = np.minimum(times[begins] * force[:, first], HIGH_N)
    z = rig.follow(force, DT, place)
    z += rig.readout.noise * random.normal(size=z.shape)
    return DT * np.arange(1, SAMPLES + 1), force[:, case.places], z


def _half_sine(length: int) -> np.ndarray:
    return np.sin(np.pi * np.arange(1, length + 1) / (length + 1))


def _times(random: np.random.Generator, rest: float) -> list[tuple[int, int]]:
    """Begin and length of presses, in samples, with rests of exponential length between them."""
    found, now, mean = [], 0, np.mean(LENGTH) * rest / (1 - rest)
    while True:
        now += int(random.exponential(mean))
        length = int(random.integers(*LENGTH))
        if now + length > SAMPLES:
            return found
        found.append((now, length))
        now += length


# Columns of G from readings, their order, sign and length from those known


def independent(z: Readings, known: Gains) -> Gains:
    """Hyvarinen's FastICA, which makes the signals as unlike a Gaussian as it can."""
    from sklearn.decomposition import FastICA

    with warnings.catch_warnings():
        # It says so where no direction is better than another.
        warnings.simplefilter("ignore")
        found = FastICA(
            2, whiten="unit-variance", fun=CONTRAST, random_state=0, max_iter=500, tol=1e-5
        ).fit(z)
    return matched(np.asarray(found.mixing_), known)


def matched(found: Gains, known: Gains) -> Gains:
    """Columns in the order, with the sign and the length of those of single presses.

    Nothing in the readings tells these: how much one place's signal is in N has to be shown once.
    """
    units = found / np.linalg.norm(found, axis=0)
    like = known.T @ units / np.linalg.norm(known, axis=0)[:, None]
    order = [0, 1] if abs(like[0, 0] * like[1, 1]) >= abs(like[0, 1] * like[1, 0]) else [1, 0]
    signs = np.sign([like[0, order[0]], like[1, order[1]]])
    return units[:, order] * signs * np.linalg.norm(known, axis=0)


def alone(z: Readings, known: Gains) -> Gains | None:
    """The outermost directions; None where no place is pressed alone."""
    try:
        return gains_in_use(z, known)
    except InputError:
        return None


WAYS: dict[str, Callable[[Readings, Gains], Gains | None]] = {
    "known": lambda _, known: known,
    "independent": independent,
    "alone": alone,
}


def _degrees(found: Gains, true: Gains) -> float:
    """Mean angle between their columns."""
    lengths = np.linalg.norm(found, axis=0) * np.linalg.norm(true, axis=0)
    cosine = (found * true).sum(0) / lengths
    return float(np.degrees(np.arccos(np.clip(cosine, -1, 1))).mean())


def _separated(
    taught: Taught, gains: Gains, t: np.ndarray, z: Readings
) -> Float[np.ndarray, "samples 2"]:
    signals = z @ np.linalg.pinv(gains).T
    each = zip(taught.signal_to_force, signals.T, strict=True)
    return np.stack([np.asarray(one.simulate(t, s).value) for one, s in each], 1)
