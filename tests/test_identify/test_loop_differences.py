"""Which figures two groups of specimens differ in: known differences, chance, specimens needed."""

from typing import Any

import numpy as np
import pytest
from scipy.stats import ttest_ind

from hysteresis import InputError, Record
from identify import compare_loops


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
    with pytest.raises(InputError) as caught:
        compare_loops([], group(0, 2, 3.0))
    assert caught.value.code == "too-few-fits"
