"""Strengths of groups of columns: gradients, minima, and what they find."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import approx_fprime

from identify.linear._cross_validation import normal_equations_of
from identify.linear._group_strengths import Group, GroupedColumns, Strengths
from identify.records._folds import Fold

PARTS = 4
FOLDS = [Fold(tuple(p for p in range(PARTS) if p != k), (k,)) for k in range(PARTS)]


def problem(seed: int, rows: int = 120) -> tuple[np.ndarray, np.ndarray, list[Group], np.ndarray]:
    """A line that counts, a curve of eight ramps that counts a little, and five columns of noise."""
    random = np.random.default_rng(seed)
    u = random.uniform(size=rows)
    ramps = np.clip(8 * u[:, None] - np.arange(8), 0, 1)
    X = np.column_stack([u, ramps, random.normal(size=(rows, 5))])
    y = 3 * u + 0.5 * np.sin(6 * u) + 0.05 * random.normal(size=rows)
    places = [np.zeros((1, 1)), np.arange(8.0)[:, None] / 2, 9.0 * np.arange(5)[:, None]]
    ends = np.cumsum([0, 1, 8, 5])
    groups = [
        Group(np.arange(a, b), p, is_expected=a == 0)
        for a, b, p in zip(ends, ends[1:], places, strict=False)
    ]
    return X, (y - y.mean()) / y.std(), groups, np.arange(rows) * PARTS // rows


def searched(seed: int) -> tuple[GroupedColumns, Strengths, np.ndarray, np.ndarray]:
    X, y, groups, part = problem(seed)
    columns = GroupedColumns(X, groups)
    normal = normal_equations_of(columns.whitened, y, {p: part == p for p in range(PARTS)})
    return columns, Strengths(columns, normal, FOLDS), X, y


@settings(max_examples=5)
@given(st.integers(0, 99), st.lists(st.floats(-6, 4), min_size=3, max_size=3))
def test_the_gradient_is_that_of_differences(seed: int, logs: list[float]):
    strengths = searched(seed)[1]
    at = np.array(logs)
    value, slope = strengths.objective(at)
    expected = approx_fprime(at, lambda x: strengths.objective(x)[0], 1e-6)
    # Forward differences of a value of some tens lose nine of sixteen digits.
    np.testing.assert_allclose(slope, expected, atol=1e-4 * max(1.0, abs(value)))


def test_a_column_that_never_changes_has_no_weight():
    X, y, groups, part = problem(3)
    X[:, 4] = 7.0
    columns = GroupedColumns(X, groups)
    normal = normal_equations_of(columns.whitened, y, {p: part == p for p in range(PARTS)})
    weights, _ = columns.weights(Strengths(columns, normal, FOLDS).solution(range(PARTS)))
    assert weights[4] == 0.0
