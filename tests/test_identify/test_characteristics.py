"""What a fit says of the specimen: figures of known loops and holds, and how groups of loops differ."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.stats import ttest_ind

from hysteresis import Record
from identify import compare_loops
from tests.refusals import refuses
from tests.test_identify.lines import line, pressed

CYCLES, ROWS = 4, 200
STIFFNESS, WIDTH, TAU = 2.5, 0.8, 3.0


def record_of(force: np.ndarray, x: np.ndarray, t: np.ndarray, turned: bool = False) -> Record:
    u, y, units = (force, x, ("N", "mm")) if turned else (x, force, ("mm", "N"))
    return Record.from_arrays(u, y, t, input_unit=units[0], output_unit=units[1], time_unit="s")


def rig(hold: float = 0.0, softer: float = 0.0, drift: float = 0.0) -> tuple[np.ndarray, ...]:
    """Round loops of 2 mm: 2.5 N/mm with branches 0.8 N apart, then a hold in which 1 N relaxes."""
    k, angle = np.divmod(np.arange(CYCLES * ROWS + 1), ROWS)
    angle = 2 * np.pi * angle / ROWS
    x, gone = 1 - np.cos(angle), np.minimum(k, CYCLES - 1) / (CYCLES - 1)
    force = STIFFNESS * (1 - softer * gone) * x + 2 * WIDTH / np.pi * np.sin(angle) + drift * gone
    if hold:
        t = np.arange(0, hold, 0.05)
        x, force = np.append(x, np.full(len(t), x[-1])), np.append(force, np.exp(-t / TAU) - 1)
    return x, force, 0.05 * np.arange(len(x))


def told(record: Record, error: np.ndarray | float = 0.0) -> dict[str, Any]:
    residuals = np.zeros(len(record)) + error
    plain = line(*pressed(1.0, 0.0, 0))
    found = replace(plain, train=record, residuals=residuals, used=record.mask)
    return {one.name: one for one in found.characteristics}


def test_figures_of_a_known_loop():
    x, force, t = rig(softer=0.1, drift=0.3)
    found = told(record_of(force, x, t))
    assert found["stiffness"].value == pytest.approx(0.95 * STIFFNESS, rel=0.02)
    assert found["softening"].value == pytest.approx(10, abs=0.5)
    assert found["zero drift"].value == pytest.approx(0.3, abs=0.02)
    errors = [one.error for one in found.values() if one.value is not None]
    assert errors == pytest.approx([0.0] * 6, abs=1e-9)
    x, force, t = rig()
    found = told(record_of(force, x, t))
    assert found["loop width"].value == pytest.approx(WIDTH, rel=0.02)
    assert found["energy lost"].value == pytest.approx(2 * WIDTH, rel=0.02)
    assert found["energy lost"].unit == "N * mm"
    warm = {"columns": {"oven": 20 + t}, "conditions": {"oven": "degC"}}
    far = replace(record_of(1e6 + force, 1e6 + x, t, turned=True), **warm)
    basis = told(far)["loop width"].basis
    assert basis.startswith("4 cycles from 9999")
    assert basis.endswith(", at 20 to 60 degC")
    x, force, t = rig(hold=30.0)
    assert told(record_of(force, x, t))["relaxation time"].value == pytest.approx(TAU, rel=0.1)


def test_the_relaxation_time_of_a_logarithmic_clock():
    """As much relaxes in each decade; the last tenth of the rows is three quarters of the time."""
    t = np.geomspace(1e-3, 1e3, 301)
    record = record_of(5 - np.log10(t), np.ones(len(t)), t)
    mean = 1e3 / np.log(10) / 6  # of log10(1000 / t), over six decades
    assert told(record)["relaxation time"].value == pytest.approx(mean, rel=0.1)


def test_stiffness_is_load_over_deformation_whichever_is_the_input():
    x, force, t = rig()
    for turned in (False, True):
        found = told(record_of(force, x, t, turned))
        # The middle of a round loop is another line along the other axis.
        assert found["stiffness"].value == pytest.approx(STIFFNESS, rel=0.05)
        assert found["stiffness"].unit == "N / mm"
    plain = Record.from_arrays(x, force, t)
    assert "slope" in told(plain)
    assert "stiffness" not in told(plain)


def test_what_is_not_told_has_a_reason():
    x, force, t = rig()
    found = told(record_of(force, x, t))
    assert found["relaxation time"].reason == "the input is never held"
    faster = np.where(np.arange(len(t)) < 2 * ROWS, t, 2 * t - t[2 * ROWS])
    found = told(record_of(force, x, faster))
    assert found["softening"].reason == "the loop before it differs in range, rate or rest"
    ramp = slice(0, ROWS // 2)
    found = told(record_of(force[ramp], x[ramp], t[ramp]))
    assert {one.reason for one in found.values()} == {
        "no complete cycle counts",
        "the input is never held",
    }
    assert all(one.value is None and one.error is None for one in found.values())


def group(seed: int, count: int, stiffness: float, scatter: float = 0.1) -> list[Any]:
    random = np.random.default_rng(seed)
    angle = np.linspace(0, 6 * np.pi, 601) - np.pi / 2
    x = np.sin(angle)
    return [
        Record.from_arrays(
            x, (stiffness + scatter * random.normal()) * x + (0.5 + 0.02 * random.normal()) * np.cos(angle),
            input_unit="mm", output_unit="N",
        ).loops()
        for _ in range(count)
    ]  # fmt: skip


def test_a_difference_is_that_of_welch_and_clear_where_it_is_large():
    one, other = group(0, 6, 3.0), group(1, 8, 4.0)
    found = {row.name: row for row in compare_loops(one, other)}
    row = found["stiffness"]
    values = [[t["stiffness"].value[t.full].mean() for t in tables] for tables in (one, other)]
    expected = ttest_ind(*values, equal_var=False)
    assert row.difference == pytest.approx(np.mean(values[1]) - np.mean(values[0]))
    assert row.p >= expected.pvalue
    assert row.difference / row.error == pytest.approx(-expected.statistic)
    assert row.clear
    assert not found["energy lost"].clear
    assert row.needed <= 4 < found["energy lost"].needed


@pytest.mark.thorough
def test_equal_groups_are_seldom_called_different():
    clear = [
        any(row.clear for row in compare_loops(group(2 * k, 5, 3.0), group(2 * k + 1, 5, 3.0)))
        for k in range(40)
    ]
    assert np.mean(clear) <= 0.1


def test_one_specimen_has_no_spread():
    found = compare_loops(group(0, 1, 3.0), group(1, 5, 4.0))
    assert all(row.p is None and "two specimens" in row.reason for row in found)
    refuses("too-few-fits", lambda: compare_loops([], group(0, 2, 3.0)))
    in_metres = Record.from_arrays(*np.ones((2, 2)), input_unit="m", output_unit="N").loops()
    refuses("wrong-unit", lambda: compare_loops([in_metres], group(0, 2, 3.0)), "is in m and in mm")
