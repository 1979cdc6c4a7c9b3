"""Virtual rigs of two inputs that both move: one of them sets what the other does.

Each is fitted with both as inputs, `--input A --input B`; the last three tenths of the rows are held out.
"""

from collections.abc import Callable, Iterator

import numpy as np
from jaxtyping import Float

import identify
from hysteresis import Record

from .._measure import Row, noted
from .._other_rigs import judged_fit
from .verdicts import Judged

TWO = "two inputs that move"
"""What `--only` has to be part of for these rows."""

STEP, ROWS = 0.02, 2000
NOISE = 0.003
"""Standard deviation of the reading, of its range."""

T = STEP * np.arange(ROWS)
Samples = Float[np.ndarray, " samples"]


def smooth(x: Samples, rows: int) -> Samples:
    """A mean over so many rows, with Hann's weights."""
    weights = np.hanning(rows + 2)[1:-1]
    padded = np.pad(x, (rows // 2, rows - rows // 2 - 1), "edge")
    return np.convolve(padded, weights / weights.sum(), "valid")


def walk(seed: int, rows: int) -> Samples:
    """From one random level between 0 and 1 to the next, in so many rows."""
    levels = np.random.default_rng(seed).uniform(size=ROWS // rows + 2)
    return smooth(
        np.interp(np.arange(ROWS), np.arange(len(levels)) * rows, levels), max(3, rows // 4)
    )


def steps(seed: int, rows: int) -> Samples:
    """Random levels between 0 and 1, each held for so many rows."""
    levels = np.random.default_rng(seed).uniform(size=ROWS // rows + 1)
    return smooth(np.repeat(levels, rows)[:ROWS], 9)


def cycles(frequency: float, seed: int) -> Samples:
    """From 0 up to heights that change, and back."""
    return (0.5 - 0.5 * np.cos(2 * np.pi * frequency * T)) * (0.4 + 0.6 * walk(seed, 250))


def play(u: Samples, radius: float) -> Samples:
    """What follows u within a gap."""
    found, at = [], u[0]
    for x in u:
        found.append(at := min(max(at, x - radius), x + radius))
    return np.array(found)


def slow(u: Samples, tau: float) -> Samples:
    """What follows u with a time constant."""
    found, at = [], u[0]
    for x in u:
        found.append(at := at + (x - at) * STEP / tau)
    return np.array(found)


def muscle() -> tuple[Samples, ...]:
    """A pneumatic muscle over shortening and pressure, whose braid rubs the more the fuller it is."""
    u, p = cycles(0.5, 1), walk(2, 150)
    return u, p, p * (100 - 60 * u) + 150 * (u - play(u, 0.08)) * (0.3 + p) + 8 * u**2


def damper() -> tuple[Samples, ...]:
    """A magnetorheological damper over its stroke and its current."""
    x, i = np.sin(2 * np.pi * 0.7 * T) * (0.3 + 0.7 * walk(3, 200)), steps(4, 120)
    v = np.gradient(x, STEP)
    return x, i, (1 + 3 * i) * np.tanh(slow(v, 0.03) / 0.5) * 200 + (20 + 30 * i) * v + 40 * x


def elastomer() -> tuple[Samples, ...]:
    """Stroke of a dielectric elastomer over its voltage, the wider the more it is loaded."""
    v, f = walk(5, 60) * 0.9 + 0.05, walk(6, 300)
    return v, f, slow(3 * v**2 * (1 + 0.8 * f) + 0.5 * f, 0.15) + 0.4 * (v - play(v, 0.1)) + 0.3 * f


def tendon() -> tuple[Samples, ...]:
    """Pull of a tendon around a joint, over its angle and the tension behind it."""
    q, tension = cycles(0.4, 7), walk(8, 220) + 0.2
    return q, tension, tension * (1 + 0.35 * (q - play(q, 0.04)) / 0.04) + 0.3 * q


def load_cell() -> tuple[Samples, ...]:
    """Reading of a load cell over force and temperature, which moves its zero, its gain and its loop."""
    f, c = walk(9, 70), 0.6 * np.linspace(0, 1, ROWS) + 0.4 * walk(10, 500)
    return f, c, f * (1 - 0.2 * c) + 0.15 * c + 0.06 * (play(f, 0.15) - f) * (1 + c)


def foam() -> tuple[Samples, ...]:
    """A foam over its compression and its temperature, at which it softens."""
    u, c = cycles(0.3, 11), walk(12, 400)
    soft = 1 - 0.5 * c
    return (
        u,
        c,
        soft * (u + 4 * u**4) + 0.25 * soft * (u - slow(u, 0.8)) + 0.1 * (u - play(u, 0.05)),
    )


def brake() -> tuple[Samples, ...]:
    """Torque of a brake over its angle and the pressure on its pads."""
    w, p = 2 * walk(13, 90) - 1, steps(14, 160)
    return w, p, 5 * p * (w - play(w, 0.06)) / 0.06 + 0.4 * w


def magnet() -> tuple[Samples, ...]:
    """Magnetisation over field and temperature, at which it fades."""
    h, c = 2 * walk(15, 80) - 1, walk(16, 300)
    held = sum(np.tanh(3 * play(h, radius)) for radius in (0.05, 0.15, 0.3)) / 3
    return h, c, (1 - 0.4 * c) * held + 0.1 * h * c


RIGS: tuple[Callable[[], tuple[Samples, ...]], ...] = (
    muscle, damper, elastomer, tendon, load_cell, foam, brake, magnet,
)  # fmt: skip


def rows() -> Iterator[tuple[Row, Judged]]:
    """Of each rig the error over that of its best baseline."""
    for rig in RIGS:
        a, b, y = rig()
        noisy = y + NOISE * np.ptp(y) * np.random.default_rng(0).normal(size=ROWS)
        channels = {"a": "mm", "b": "bar"}
        record = Record.from_arrays(None, noisy, T, columns={"a": a, "b": b}, channels=channels)
        fit = identify.fit(record, test_tail=0.3)
        judged = judged_fit(f"{TWO}, {rig.__name__}", fit)
        what = (
            f"{judged.what}, per cent ({fit.name}; {judged.baseline} {judged.other:.3g};"
            f" {judged.level})"
        )
        yield noted(what, judged.error), judged
