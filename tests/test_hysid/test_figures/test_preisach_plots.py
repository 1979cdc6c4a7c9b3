"""Figures of the memory and the density: what they draw is what the model does."""

import io
import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from hysid import plots
from identify import forc_diagram
from identify.internal import Forc, Identifiability
from tests.problems import HIGH, LOW, histories


def drawn(figure: Figure) -> Figure:
    """The figure after all of it was drawn, which must not warn."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        figure.savefig(io.BytesIO(), format="png", dpi=40)
    return figure


def area(corners: np.ndarray) -> float:
    x, y = corners.T
    return abs(np.dot(x, np.roll(y, 1)) - np.dot(y, np.roll(x, 1))) / 2


def remembered(u: np.ndarray, low: float) -> list[float]:
    """Dominant extrema of a path from `low` to its last value, by their definition."""
    found, rest, now = [low], np.append(low, u), u[-1]
    while True:
        pick = np.argmax if len(found) % 2 else np.argmin
        k = len(rest) - 1 - int(pick(rest[::-1]))
        if rest[k] == now:
            return found
        found.append(float(rest[k]))
        rest = rest[k:]


@given(histories(LOW, HIGH))
@settings(max_examples=8)
def test_relays_up_are_the_area_below_the_staircase(history: np.ndarray):
    """Every rise from b to a switches the triangle {b <= beta <= alpha <= a} up, a fall down."""
    reversals = remembered(history, LOW)
    legs = np.diff([*reversals, history[-1]])
    expected = (np.sign(legs) * legs**2 / 2).sum()
    _, up = plots.staircase(history, LOW, HIGH).axes[1].patches
    # Corners are inputs: the area is exact to rounding.
    assert area(up.get_xy()) == pytest.approx(expected, abs=1e-12)


@given(st.permutations(range(30)))
@settings(max_examples=8)
def test_lines_last_as_long_as_the_memory(turns: list[int]):
    u = np.array(turns, float)
    figure = plots.memory(u, -1.0)
    lines = [line.get_xydata() for line in figure.axes[0].lines]
    levels = [line for line in lines if len(line) == 2 and line[0, 1] == line[1, 1]]
    bars = [bar.get_bbox() for bar in figure.axes[1].patches]
    for k in range(1, len(u)):
        expected = remembered(u[: k + 1], -1.0)[1:]
        # A reversal is one from the next sample on; a line ends where the input passes.
        there = [line[0, 1] for line in levels if line[0, 0] < k <= line[1, 0]]
        assert there == expected
        assert sum(bar.x0 < k <= bar.x1 for bar in bars) == len(expected)


def test_all_figures_draw():
    u = np.interp(np.linspace(0, 7, 90), range(8), [0, 9, 2, 7, 3, 6, 4, 8])
    for figure in (plots.staircase(u, unit="N"), plots.memory(u, unit="N")):
        assert len(drawn(figure).axes) == 2


def test_forc_colours_are_symmetric_about_zero():
    grid = np.linspace(-2, 2, 30)
    curves = tuple(
        Forc(float(b), grid[k:], np.exp(-((grid[k:] - 1) ** 2)) * (b + b**3))
        for k, b in enumerate(grid[:20])
    )
    figure = drawn(plots.forc(forc_diagram(curves, 2), input_unit="T"))
    low, high = figure.axes[0].collections[0].get_clim()
    assert low == -high < 0
    assert figure.axes[0].get_xlabel() == "coercivity (α − β)/2 (T)"


def test_border_of_the_excited_region():
    told = np.zeros((6, 6))
    told[3:5, 1:3] = 0.5
    axes = drawn(plots.identifiability(Identifiability(told, told > 0, 0.0, 6.0))).axes[0]
    (border,) = [c for c in axes.collections if type(c) is LineCollection]
    ends = {frozenset(map(tuple, segment)) for segment in border.get_segments()}
    square = [(1, 3), (2, 3), (3, 3), (3, 4), (3, 5), (2, 5), (1, 5), (1, 4)]
    assert ends == {frozenset(pair) for pair in zip(square, square[1:] + square[:1], strict=True)}
