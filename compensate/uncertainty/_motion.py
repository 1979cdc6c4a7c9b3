"""Which motions an error was learnt on, and how unlike them the present one is."""

import math
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from hysteresis import Record
from hysteresis._parameter import is_concrete
from hysteresis.laws.error import ANY_MOTION, UNMOVED
from hysteresis.running import each, numbers_of
from hysteresis.trees import Tree, node

NEAR = 0.15
"""Part of the trained range by which a reversal has to be away from those seen for half of the growth."""

DECADES = 0.7
"""How far the speed has to be beyond those seen for half of it: a factor of five."""

GROWTH = 0.3
"""Error of an estimate after a motion unlike all seen, over that of the best curve without a memory.

`benchmarks._trust.bands` measures 0.15 to 0.5 on rigs that no model here is.
"""

FASTER = 5.0
"""A clock that is so much slower tells what speed does to a model's estimates."""

TIMED = 4.0
"""Half widths of the play behind the estimates that a stroke is long before its speed is known."""

SELDOM = 0.02
"""Part of the rows at either end of what was seen that do not count: a slip is no kind of motion."""

PATH = ("up", "known", "last", "before", "speed")
"""What the law of an error keeps of a motion."""

NEVER = 1e30
"""Greater than any speed."""


class Motions(NamedTuple):
    """The inputs, reversals and speeds of rows that an error was learnt on, and how it grows beyond them.

    - `inputs`: the least and the greatest.
    - `turns`: on the way down and up, of the last reversal and the one before it, the least and greatest.
    - `speeds`: the least and the greatest mean speed of a stroke so far, in the input's unit over the
      times'; 0 and 1e30 where no speed is known, or there are no times.
    - `ends`: to which estimates are limited, and over which distances are measured.
    - `growth`: the errors far beyond those inputs and reversals, and far beyond those speeds.
    """

    inputs: Float[Array, "2"]
    turns: Float[Array, "2 2 2"]
    speeds: Float[Array, "2"]
    ends: Float[Array, "2"]
    growth: Float[Array, "2"]


def error_law(
    width: float,
    motions: Motions | None,
    levels: Any = (0.0, 1.0),
    falling: Any = (0.0, 0.0),
    rising: Any = (0.0, 0.0),
) -> Tree:
    """The law of an error, `hysteresis/laws/error.py`; without levels that of its growth alone."""
    levels, falling, rising = map(_known, (levels, falling, rising))
    if len(levels) == 1:
        levels = np.append(levels, levels + 1.0)
        falling, rising = np.repeat(falling, 2), np.repeat(rising, 2)
    known: dict[str, Any] = ANY_MOTION
    if motions is not None:
        (low, high), (least, most), (slow, fast), (growth, hurry) = map(
            _known, (motions.ends, motions.inputs, motions.speeds, motions.growth)
        )
        known = {
            "low": low, "high": high, "least": least, "most": most, "turns": motions.turns, "slow": slow,
            "fast": fast, "near": jnp.maximum(NEAR * (high - low), 1e-30),
            "factor": DECADES * math.log(10.0),
            "timed": TIMED * width, "growth": growth, "hurry": hurry,
        }  # fmt: skip
    tables = {"levels": len(levels), "level": levels, "falling": falling, "rising": rising}
    state = {"begun": 0, "follower": 0.0, "up": 1, **UNMOVED}
    return node("error", tables | {"width": width} | known, state)


def path_law(ends: tuple[float, float], width: float) -> Tree:
    """The law of an error, of which only the motion is asked for."""
    found = error_law(width, None)
    found["parameters"] |= {"low": ends[0], "high": ends[1], "timed": TIMED * width}
    return found


def _known(x: Any) -> Any:
    return np.asarray(x, float) if is_concrete(x) else x


def along(
    law: Tree,
    function: str,
    record: Record,
    value: np.ndarray,
    sound: np.ndarray,
    keeps: tuple[str, ...],
) -> np.ndarray:
    """What a function of the law of an error gives along all sequences, and what it keeps."""
    time = np.zeros(len(record)) if record.time is None else record.time
    found = np.empty((len(record), 1 + len(keeps)))
    where, numbers = np.where(sound, value, np.nan), numbers_of(law)
    for _, rows in record.sequences():
        told = each(
            numbers, function, value[rows], times=time[rows], where=where[rows], keeps=keeps
        )
        found[rows] = np.column_stack([told.value, told.said])
    return found


def seen(
    path: Float[np.ndarray, "samples columns"],
    ends: tuple[float, float],
    growth: tuple[float, float],
) -> Motions:
    """The motions of a path's rows, all but the most seldom: estimates, then what `PATH` names."""
    at, up, known, last, before, speed = path.T
    turns = np.empty((2, 2, 2))
    for way in (0, 1):
        for k, (part, have) in enumerate(((last, up == way), (before, (up == way) & (known > 0)))):
            found = part[have]
            # Where no row went this way, none is known to be unlike.
            turns[way, k] = _between(found) if len(found) else ends
    timed = speed[speed > 0]
    speeds = _between(timed) if len(timed) else [0.0, NEVER]
    inputs = at.min(), at.max()
    return Motions(*(jnp.asarray(part, float) for part in (inputs, turns, speeds, ends, growth)))


def _between(found: np.ndarray) -> np.ndarray:
    return np.quantile(found, [SELDOM, 1 - SELDOM])
