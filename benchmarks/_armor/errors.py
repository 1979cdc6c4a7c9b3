"""Virtual armors calibrated by twenty presses: errors of their contacts, and whether ellipsoids hold.

Each rig is another sensor with another cover; the foam model of each kind of rigs is fitted once, to blocks
of the same sponge that are pressed for the first time.
"""

import sys
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy.stats
from jaxtyping import Array, Bool, Float

from compensate.armor._armor import UncertainContact
from compensate.internal import UncertainArmor
from hysid.reproduction._armor import calibrated
from hysteresis.rigs import INWARD, ArmorRig
from hysteresis.rigs._armor import ArmorPresses

from .._measure import Row, judged, noted

RIGS, FEW = 10, 2
"""Of each kind."""

KINDS: dict[str, Callable[..., ArmorRig]] = {
    "rigs outside our classes": ArmorRig.of_foam,
    "rigs close to our classes": ArmorRig,
}

LEAST = 2.0
"""N, from which on a mixed press counts."""


class Errors(NamedTuple):
    """Of one rig: means in mm, and the part of the true contacts that 90 % ellipsoids hold."""

    body: float
    """45 points at 15 N, |P^e|"""
    body_held: float
    mixed: float
    """76 points, 2 to 20 N up and down, |d_n|"""
    mixed_line: float
    """the same by approximation 2"""
    mixed_held: float
    lost: int
    """presses whose surface was not found"""
    mixed_unknown: float
    """of the 76 points, what unevenness of cover and hand does to d: no presses elsewhere tell it"""


@eqx.filter_jit
def followed(armor: UncertainArmor, time: Array, readings: Array) -> UncertainContact:
    """The contacts of presses, every one a stream of its own: arrays (presses, ...)."""
    return jax.lax.map(lambda each: armor.simulate(time, each), readings)


@jax.jit
def covariances(found: UncertainContact) -> Float[Array, "presses samples 3 3"]:
    """Of P^e of all of them, m^2."""
    return jax.vmap(lambda one: one.covariance)(found)


def error_rows(quick: bool) -> list[Row]:
    """Over rigs of the seeds 0, 1, ..., each calibrated by twenty presses."""
    count = FEW if quick else RIGS
    return [row for kind, make in KINDS.items() for row in _of_kind(kind, make, count)]


def _of_kind(kind: str, make: Callable[..., ArmorRig], count: int) -> list[Row]:
    found = []
    for seed in range(count):
        found.append(of_rig(make(seed=seed)))
        print(f"  {kind}, {seed}: {found[-1]}", file=sys.stderr, flush=True)
    mean = Errors(*np.mean(found, axis=0).tolist())
    sd = Errors(*np.std(found, axis=0, ddof=1).tolist())
    floor = float(np.mean([_floor(make(seed=seed)) for seed in range(count)]))
    held = 50 * (mean.body_held + mean.mixed_held)
    ratio = "76 points, loading and unloading mixed at 2 to 20 N, against approximation 2"
    body = "45 points, 15 N, after calibration on 20 other presses: mean error, mm"
    ellipsoids = f"covariance: 90 % ellipsoids that hold the contact ({count} {kind}), %"
    return [
        judged(f"{ratio} ({count} {kind})", mean.mixed / mean.mixed_line, 0.3),
        noted("    the least ratio: unevenness alone", mean.mixed_unknown / mean.mixed_line),
        noted("    mean error of d, mm", mean.mixed, sd.mixed),
        judged(f"{body} ({count} {kind})", mean.body, 3.5),
        noted("    deviation from rig to rig, mm", sd.body),
        noted("    noise floor: sensor known, d known in the mean, mm", floor),
        Row(ellipsoids, held, 86.0, None, 86 <= held <= 94, "86 to 94", at_least=True),
        noted("    of the 45 points, %", 100 * mean.body_held),
        noted("    of the 76 points, up and down, %", 100 * mean.mixed_held),
        noted("    contacts on another surface, or none, a rig", mean.lost),
    ]


def of_rig(rig: ArmorRig) -> Errors:
    """Calibrate one rig by the chosen presses, then press it elsewhere."""
    armor, seed = calibrated(rig), rig.seed
    body = rig.press(*rig.points_of_the_body(), session=5)
    mixed = rig.press(*rig.points_of_surface_1(), _mixed_forces(76, seed=seed), session=6)
    of_body, of_mixed = (
        followed(armor.uncertain, jnp.asarray(p.time), jnp.asarray(p.wrench)) for p in (body, mixed)
    )
    counted = mixed.force >= LEAST
    line = rig.cover.five_cycles().statistics().both
    d = 1e3 * mixed.displacement
    return Errors(
        body=1e3 * float(np.linalg.norm(off(of_body, body)[:, -1], axis=-1).mean()),
        body_held=float(held(of_body, body)[:, -1].mean()),
        mixed=float(np.abs(1e3 * np.asarray(of_mixed.contact.displacement) - d)[counted].mean()),
        mixed_line=float(np.abs(line.K * mixed.force + line.b - d)[counted].mean()),
        mixed_held=float(held(of_mixed, mixed)[counted].mean()),
        lost=sum(
            int(np.sum(np.asarray(c.contact.surface)[:, -1] != presses.surface))
            for c, presses in ((of_body, body), (of_mixed, mixed))
        ),
        mixed_unknown=float(unevenness(rig, mixed)[counted].mean()),
    )


def unevenness(rig: ArmorRig, presses: ArmorPresses) -> Float[np.ndarray, "presses samples"]:
    """How far d is from that of the same rig with an even cover and hand, mm."""
    even = replace(rig, scatter_mm=0.0, uneven=0.0)
    same = even.press(presses.touched, presses.surface, presses.force, session=6)
    return 1e3 * np.abs(presses.displacement - same.displacement)


def off(found: UncertainContact, presses: ArmorPresses) -> Float[np.ndarray, "presses samples 3"]:
    """P^e found less the true one, m."""
    return np.asarray(found.contact.point) - presses.contact


def held(found: UncertainContact, presses: ArmorPresses) -> Bool[np.ndarray, "presses samples"]:
    """Whether the true contact lies in the 90 % ellipsoid."""
    e, covariance = off(found, presses), np.asarray(covariances(found))
    known = np.isfinite(covariance[..., 0, 0])
    safe = np.where(known[..., None, None], covariance, np.eye(3))
    square = np.einsum("...i,...ij,...j->...", e, np.linalg.inv(safe), e)
    return np.logical_and(known, square < scipy.stats.chi2.ppf(0.9, 3))


def _floor(rig: ArmorRig) -> float:
    """Mean error at the 45 points with the true sensor but its noise, and the mean of d for all, mm."""
    body = rig.press(*rig.points_of_the_body(), session=5)
    normal = INWARD[body.surface - 1]
    random = np.random.default_rng([rig.seed, 8])
    noise = np.repeat([rig.sensor.noise_n, rig.sensor.noise_nm], 3)
    wrench = body.load[:, -1] + noise * random.normal(size=(len(normal), 6))
    F, M = wrench[:, :3], wrench[:, 3:]
    foot = np.cross(F, M) / np.sum(F * F, axis=1, keepdims=True)
    depth = body.displacement[:, -1].mean()
    height = np.sum((body.touched - foot) * normal, axis=1) + depth
    found = foot + (height / np.sum(F * normal, axis=1))[:, None] * F
    return 1e3 * float(np.linalg.norm(found - body.contact[:, -1], axis=1).mean())


def _mixed_forces(
    presses: int, samples: int = 40, *, low: float = 2.0, high: float = 20.0, seed: int = 0
) -> Float[np.ndarray, "presses samples"]:
    """Histories that load and unload between `low` and `high` N, each at another stage of another path.

    Each starts from 0 N, reverses three to six times, in the upper and the lower third of the range by
    turns, and ends anywhere.
    """
    rng = np.random.default_rng(seed)
    third = (high - low) / 3
    paths = []
    for _ in range(presses):
        turns = rng.uniform(low, low + third, rng.integers(3, 7))
        turns[::2] += 2 * third
        turns = np.concatenate([[0.0], turns, [rng.uniform(low, high)]])
        way = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(turns)))])
        paths.append(np.interp(np.linspace(0, way[-1], samples + 1)[1:], way, turns))
    return np.array(paths)
