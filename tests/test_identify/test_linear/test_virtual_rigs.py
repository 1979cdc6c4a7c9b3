"""Rigs of other kinds, each by a plain loop over time; no model of ours is one of them."""

import numpy as np
import pytest

from hysteresis import Record
from identify import fit
from tests.thorough import rest_thorough

NOISE = 0.002
"""Of the output's range."""


def cycles(heights: list[float], rows: int = 80) -> np.ndarray:
    """From 0 up to each height and back, evenly."""
    half = np.linspace(0, 1, rows // 2, endpoint=False)
    return np.concatenate([h * np.append(half, half[::-1]) for h in heights])


def damper(u: np.ndarray) -> np.ndarray:
    """A drum that turns through a gap before its band holds: two sliders, one behind the gap."""
    gap, first, second, y = 0.0, 0.0, 0.0, []
    u = u - np.mean([u.min(), u.max()])
    for here, before in zip(u, np.append(0.0, u[:-1]), strict=True):
        inside = np.clip(gap, here - 0.06, here + 0.06)
        first = np.clip(first + 20 * (here - before), -0.5, 0.5)
        second, gap = np.clip(second + 20 * (inside - gap), -0.5, 0.5), inside
        y.append(first + second)
    return np.array(y)


def velostat(u: np.ndarray) -> np.ndarray:
    """Resistance of a force-sensing sheet: it falls with the force, and contacts creep."""
    contact, y = 0.0, []
    for force in u:
        contact += 0.05 * (force - contact)
        y.append(1 / (0.3 + force + 0.3 * contact))
    return np.array(y)


def memory_alloy(u: np.ndarray) -> np.ndarray:
    """Strain of a wire over its temperature: it relaxes at lower ones than it contracts at."""
    up = np.linspace(0.45, 0.95, 40)
    hot, y = np.zeros(40, bool), []
    for temperature in u:
        hot = (temperature >= up) | hot & (temperature > up - 0.3)
        y.append(1 - hot.mean() + 0.05 * temperature)
    return np.array(y)


def block(u: np.ndarray) -> np.ndarray:
    """A foam whose force falls from cycle to cycle, by less and less."""
    gone = np.append(0.0, np.cumsum(np.abs(np.diff(u))))
    return u + 2 * u**3 + 0.1 * np.append(0.0, np.sign(np.diff(u))) - 0.1 * np.log1p(gone)


HEIGHTS = [1.0, 0.5, 0.8, 0.3, 0.65, 0.9]


@pytest.mark.parametrize(("rig", "trained", "tested", "part", "bar"), rest_thorough([
    (block, [1.0] * 7, [1.0] * 4, "drift", 0.9),
    (damper, HEIGHTS, [0.75, 0.55], "stops", 1.05),
    (velostat, HEIGHTS, [0.7, 0.95], "", 0.5),
    (memory_alloy, HEIGHTS, [0.85, 0.7], "relays", 0.5),
], 2))  # fmt: skip
def test_a_rig_is_learnt_beyond_the_best_baseline(rig, trained, tested, part, bar):
    """The damper is what ridge regression on stops is made for: there it is enough to be as good. The block
    goes on softening: what explains its rows is in no prediction, and the verdict says that errors grow."""
    u = cycles([*trained, *tested])
    exact = rig(u)
    y = exact + NOISE * np.ptp(exact) * np.random.default_rng(0).normal(size=len(u))
    time = 0.02 * np.arange(len(u)) if rig is velostat else None
    found = fit(Record.from_arrays(u, y, time), "Composition", test_cycles=len(tested))
    assert type(found.detail).__name__ == "Composition"
    assert part in " + ".join(found.detail.linear.meaning.parts)
    test = found.metrics["test"]
    others = [baseline.judged[0] for baseline in found.baselines]
    assert test.rmse < bar * min(others)
    assert found.verdict.level == ("CAUTION" if rig is block else "PASS")
    assert ("growth" in found.verdict.codes) == (rig is block)
