"""Forces of one contact and of two on virtual microchannel sensors."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from hysid.reproduction._skin import HIGH_N, Records, Series, Skin, converted, decaying_over
from hysid.reproduction._skin_paper import error, found_peaks
from hysteresis.internal import ResistiveReadout
from hysteresis.rigs import MicrochannelRig
from identify.internal import train
from identify.training._train import Trained

from .._measure import Row, judged, means, noted
from .everett_network import EverettNetwork
from .floor import floor, placement_floor
from .inside import DELAY, InsidePair, InsideSkin

FEW = 3
"""Sensors, of the seeds 0, 1, 2."""


def force_rows(quick: bool) -> list[Row]:
    """Rows of the forces of single contacts."""
    found = [_single(seed, quick) for seed in range(1 if quick else FEW)]
    mean = means(found)
    late = f"{DELAY} readings late"
    # The best kind is (iii), a model of the sensor run backwards.
    what = "(A) on the virtual sensor, force RMSE, N"
    return [
        judged(f"{what}: (i) network, delayed readings", mean["network"], 0.055),
        noted("    as the paper describes it, without time", mean["timeless"]),
        noted("    (ii) monotone Everett network", mean["everett"]),
        judged(f"{what}: best kind, {late}", mean["late"], 0.03),
        noted("    as the readings come", mean["now"]),
        noted("    floor, the rig's own law known: as the readings come", mean["floor"]),
        noted(f"    floor: the same, {late}", mean["floor_late"]),
        noted("    readings within its 90 % band, as they come, %", mean["held"]),
    ]  # fmt: skip


def _single(seed: int, quick: bool) -> dict[str, float]:
    """RMSE of every kind over the four loops of four sessions."""
    skin = InsideSkin(seed, 200 if quick else 1000, sessions=4)
    t, F, z = skin.taught
    everett = _train_everett(t, z, F, epochs=150 if quick else 600, high_force=HIGH_N)
    now = skin.by_filter["value"]
    off = [np.abs(a - b) for a, b in zip(now, skin.loops.force, strict=True)]
    pairs = zip(off, skin.by_filter["deviation"], strict=True)
    least, least_late = floor(MicrochannelRig(seed=seed), skin.loops)
    return {
        "network": skin.rms(skin.ours.forces),
        "timeless": skin.rms(skin.paper.forces),
        "everett": skin.rms(skin.by(everett)),
        "now": skin.rms(now),
        "late": skin.rms_late,
        "held": 100 * float(np.mean(np.concatenate([e < 1.645 * s for e, s in pairs]))),
        "floor": least,
        "floor_late": least_late,
    }


def pair_rows(quick: bool) -> list[Row]:
    """Rows of the forces of two contacts, learnt from a machine's presses of one location at a time."""
    found = [_pair(seed, quick) for seed in range(1 if quick else FEW)]
    mean = means(found)
    rows = [
        judged(
            "(D) on two locations, peaks of 16, paper's method", mean["peaks"], 16, at_least=True
        ),
        judged("(D) on two locations, force RMSE, ours to the paper's method", mean["ratio"], 0.5),
    ]
    if quick:
        why = "its networks need minutes to learn: without --quick"
        rows = [row._replace(met=None, reason=why) for row in rows]
    return [
        *rows,
        judged("(D) on two locations, paper's step to ours", mean["speed"], 50.0, at_least=True),
        noted("    RMSE, placed presses, ours, N", mean["ours"]),
        noted("    paper's, N", mean["paper"]),
        noted("    peaks of 16, ours", mean["our_peaks"]),
        noted("    RMSE, a finger's presses, ours, N", mean["finger"]),
        noted("    paper's, N", mean["finger_paper"]),
        noted("    the sensor's law known, the finger's placement not, N", mean["finger_floor"]),
        noted("    peaks of 16, a finger's presses, paper's method", mean["finger_peaks"]),
        noted("    ours, step, us", mean["step_us"]),
    ]  # fmt: skip


def _pair(seed: int, quick: bool) -> dict[str, float]:
    pair = InsidePair(seed, 4 if quick else 100)
    return {
        "peaks": found_peaks(pair.placed),
        "our_peaks": found_peaks(pair.placed, ours=True),
        "paper": error(pair.placed),
        "ours": error(pair.placed, ours=True),
        "ratio": error(pair.placed, ours=True) / error(pair.placed),
        "finger": error(pair.together, ours=True),
        "finger_paper": error(pair.together),
        "finger_floor": placement_floor(MicrochannelRig(seed=seed), pair.together),
        "finger_peaks": found_peaks(pair.together),
        "speed": pair.paper_us / pair.ours_us,
        "step_us": pair.ours_us,
    }


def electronics_rows(quick: bool) -> list[Row]:
    """What each part of the electronics costs in force, on a skin by its geometry: the error of one network
    on loops that come through other electronics than it was taught with."""
    skin, rows = Skin(0, 60 if quick else 1000), []
    for name, (electronics, believed) in _variants().items():
        loops = replace(skin.rig, readout=electronics).test_loops(session=0)
        volts = [converted(one.reading, electronics, believed)[:, 0] for one in loops]
        made = Records([one.time for one in loops], [one.force[:, 0] for one in loops], volts)
        off = skin.rms(skin.by(skin.ours.network, made))
        rows.append(noted(f"electronics, {name}: force of four loops, N", off))
    return rows


def _variants() -> dict[str, tuple[ResistiveReadout, float | None]]:
    """Electronics, and the current in A that `Readout` takes for theirs."""
    usual = ResistiveReadout()
    quiet, coarse, fine = (replace(usual, **c) for c in ({"noise": 0.0}, {"bits": 8}, {"bits": 14}))
    whole = replace(usual, noise=0.0, bits=24, low_pass_s=1e-6)
    return {
        "as built: 75 mA, 2 ms, 20 mV of noise, 10 bits": (usual, None),
        "70 mA, known": (replace(usual, current_a=0.070), None),
        "80 mA, known": (replace(usual, current_a=0.080), None),
        "70 mA, taken for 75 mA": (replace(usual, current_a=0.070), usual.current_a),
        "80 mA, taken for 75 mA": (replace(usual, current_a=0.080), usual.current_a),
        "no noise of the amplifier": (quiet, None),
        "low-pass of 20 ms": (replace(usual, low_pass_s=0.02), None),
        "8 bits": (coarse, None),
        "14 bits": (fine, None),
        "no electronics: no noise, no low-pass, 24 bits": (whole, None),
    }


def _train_everett(
    times: Sequence[Series],
    readings: Sequence[Series],
    forces: Sequence[Series],
    *,
    epochs: int = 600,
    high_force: float,
) -> Trained:
    """`EverettNetwork` from readings to forces, records of one length; five of them a batch."""
    t, z, F = (jnp.asarray(np.stack(part)) for part in (times, readings, forces))
    start = EverettNetwork.random(jax.random.key(0), high=float(z.max()), force=high_force)
    return train(
        start, _sequence_squares, (t, z, F), batch=5, epochs=epochs,
        optimizer=decaying_over(2e-2, epochs, len(times), 5),
    )  # fmt: skip


def _sequence_squares(network: EverettNetwork, rows: Any, key: Any) -> Array:
    t, reading, force = rows
    return jnp.mean((jax.vmap(network.simulate)(t, reading) - force) ** 2)
