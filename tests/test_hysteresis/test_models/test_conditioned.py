"""Models of an input and a condition, and maps of several channels."""

from dataclasses import replace
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hysteresis import (
    Burgers,
    ChannelMap,
    Conditioned,
    InputError,
    LinearSponge,
    MonotoneCurve,
    PrandtlIshlinskii,
    Preisach,
    Record,
    Series,
    Sum,
)
from hysteresis.curves import Clip
from hysteresis.internal import extended
from hysteresis.preisach import GridDensity
from hysteresis.testing import check_model
from tests.refusals import raises, refuses

KNOTS = [1.0, 2.0, 5.0]


def with_loops(gain: float, relays: float) -> Sum:
    """A curve and relays on [-1, 2]."""
    density = GridDensity(-1.0, 2.0, relays * np.tril(np.ones((4, 4))))
    return Sum(MonotoneCurve.even(-1.0, 2.0, gain * np.array([1.0, 2.0])), Preisach(density))


def three(axis: str = "linear") -> Conditioned:
    """Loops that narrow as the condition rises."""
    models = [with_loops(1.0, 0.5), with_loops(2.0, 0.3), with_loops(1.5, 0.1)]
    return Conditioned(tuple(models), KNOTS, "temperature", "K", axis)


def walk(condition: Any, samples: int = 60, seed: int = 0) -> np.ndarray:
    """Inputs between turning points, beside a condition."""
    random = np.random.default_rng(seed)
    u = np.interp(np.linspace(0, 9, samples), np.arange(10), random.uniform(-1.0, 2.0, 10))
    return np.column_stack([u, np.broadcast_to(condition, samples)])


def plays(slope: float, weight: float) -> PrandtlIshlinskii:
    return PrandtlIshlinskii([0.2, 0.7], [weight, 2 * weight], slope)


def test_it_keeps_the_laws_of_every_model():
    parts = (plays(1.0, 0.5), plays(2.0, 0.3))
    check_model(Conditioned(parts, [1.0, 3.0], axis="reciprocal"), -1.0, 2.0)


@pytest.mark.parametrize("axis", ["linear", "logarithmic", "reciprocal"])
def test_at_a_knot_it_is_the_model_of_the_knot_and_beyond_them_the_nearest(axis: str):
    model = three(axis)
    for k, c in enumerate(KNOTS):
        rows = walk(c)
        alone = model.models[k].simulate(None, rows[:, 0])
        np.testing.assert_allclose(model.simulate(None, rows), alone, atol=1e-14)
    for outside, inside in ((0.1, 1.0), (90.0, 5.0)):
        got, wanted = (model.simulate(None, walk(c)) for c in (outside, inside))
        np.testing.assert_array_equal(got, wanted)


@pytest.mark.parametrize(
    ("axis", "c", "share"),
    [("linear", 3.0, 1 / 3), ("logarithmic", np.sqrt(10.0), 0.5), ("reciprocal", 20 / 7, 0.5)],
)
def test_between_two_knots_it_is_straight_on_its_axis(axis: str, c: float, share: float):
    model = three(axis)
    low, high = (model.simulate(None, walk(at)) for at in (2.0, 5.0))
    between = (1 - share) * low + share * high
    np.testing.assert_allclose(model.simulate(None, walk(c)), between, atol=1e-13)


@pytest.mark.parametrize(
    ("axis", "c", "step"),
    [("linear", 8.0, 1.0), ("logarithmic", 12.5, 1.0), ("reciprocal", 10.0, 1 / 3)],
)
def test_widened_it_goes_on_straight_beyond_its_knots(axis: str, c: float, step: float):
    model = three(axis)
    wide = extended(model, -2.0, 3.0, (0.0, c))
    near, last = (model.simulate(None, walk(at)) for at in (2.0, 5.0))
    beyond = last + step * (last - near)
    np.testing.assert_allclose(wide.simulate(None, walk(c)), beyond, atol=1e-12)
    inside = walk(np.linspace(1.0, 5.0, 60))
    wanted = model.simulate(None, inside)
    np.testing.assert_allclose(wide.simulate(None, inside), wanted, atol=1e-12)


def test_a_stage_behind_it_and_wider_relays_keep_its_outputs():
    model, rows = three(), walk(np.linspace(0.0, 6.0, 60))
    y = model.simulate(None, rows)
    wide, tolerance = extended(model, -2.0, 3.0), 1e-12 * float(jnp.abs(y).max())
    np.testing.assert_allclose(wide.simulate(None, rows), y, atol=tolerance)
    clipped = Series(model, Clip(low=0.0))
    np.testing.assert_array_equal(clipped.simulate(None, rows), np.maximum(y, 0.0))
    assert clipped.parts[0].condition == "temperature"


def test_what_is_no_conditioned_model_is_refused():
    line = LinearSponge(1.0, 0.0)
    for parts, knots, code in (
        ((), [], "bad-parts"),
        ((line, Burgers(2.0, 40.0, 1.0, 5.0)), [0.0, 1.0], "bad-parts"),
        ((line,), [0.0, 1.0], "length-mismatch"),
        ((line, line), [1.0, 1.0], "parameter-out-of-bounds"),
    ):
        with raises(code):
            Conditioned(parts, knots)
    with pytest.raises(InputError, match="above 0"):
        Conditioned((line, line), [-1.0, 1.0], axis="logarithmic")
    refuses("bad-option", lambda: replace(three(), axis="cubic"))
    refuses("wrong-shape", lambda: three().simulate(None, np.zeros(5)))


CHANNELS, CELLS, SAMPLES = 3, 4, 30
NAMES = ("near", "far", "side")
UNITS = ("mT", "V", "1")


def made(seed: int) -> ChannelMap:
    rng = np.random.default_rng(seed)
    nodes = np.cumsum(rng.uniform(0.1, 1.0, (CHANNELS, CELLS + 1)), axis=1)
    return ChannelMap(nodes, rng.normal(size=nodes.shape), rng.normal(), NAMES, UNITS)


def samples(seed: int) -> np.ndarray:
    """Values inside and beyond the nodes."""
    return np.random.default_rng(seed).uniform(-1.0, 6.0, (SAMPLES, CHANNELS))


def slowly(map: ChannelMap, x: np.ndarray) -> np.ndarray:
    """Cell by cell, from the equation."""
    nodes, values = np.asarray(map.nodes), np.asarray(map.values)
    found = np.full(len(x), float(map.offset))
    for row, sample in enumerate(x):
        for c, u in enumerate(np.clip(sample, nodes[:, 0], nodes[:, -1])):
            k = max(k for k in range(CELLS) if u >= nodes[c, k])
            share = (u - nodes[c, k]) / (nodes[c, k + 1] - nodes[c, k])
            found[row] += values[c, k] + share * (values[c, k + 1] - values[c, k])
    return found


@given(st.integers(0, 2**32 - 1))
def test_a_map_is_the_sum_of_its_curves(seed: int):
    map, x = made(seed), samples(seed)
    # A dozen products of numbers near one, each rounded.
    np.testing.assert_allclose(map(x), slowly(map, x), rtol=0, atol=1e-12)


@pytest.mark.parametrize(("changes", "code"), [
    ({"values": np.zeros((3, 4))}, "length-mismatch"),
    ({"names": ("a", "b")}, "length-mismatch"),
    ({"nodes": np.zeros((3, 1)), "values": np.zeros((3, 1))}, "length-mismatch"),
    ({"nodes": np.zeros((3, 5))}, "parameter-out-of-bounds"),
])  # fmt: skip
def test_bad_arguments_are_refused(changes: dict[str, Any], code: str):
    good = made(0)
    arguments = {k: getattr(good, k) for k in ("nodes", "values", "offset", "names", "units")}
    refuses(code, lambda: ChannelMap(**(arguments | changes)))


def rig(**options: Any) -> Record:
    t = 0.1 * np.arange(240)
    s = 0.5 - 0.5 * np.cos(2 * np.pi * t / 4.0)
    columns = {"a (mT)": 3 * s, "b (V)": 1 - s**2, "run": np.repeat([1.0, 2.0], 120)}
    channels = {"a (mT)": "mT", "b (V)": "V"}
    arguments: dict[str, Any] = {"columns": columns, "channels": channels, "groups": columns["run"]}
    arguments |= options
    return Record.from_arrays(None, 10 * s, t, **arguments)


def test_a_record_carries_its_channels_through_every_split():
    record = rig()
    assert record.cycle_counts.tolist() == [3, 3]
    train, test = record.split_cycles(1)
    parts = [train, test, *record.split_groups(["2.0"]), *record.split_tail(0.2), record]
    for part in parts:
        assert part.channels == {"a (mT)": "mT", "b (V)": "V"}
        assert all(len(part.columns[name]) == len(part) for name in part.channels)
    second = record.take_sequences(["2.0"])
    np.testing.assert_array_equal(second.columns["a (mT)"], record.columns["a (mT)"][120:])


def test_a_gap_in_a_channel_is_named_or_filled():
    a = np.arange(240.0)
    a[7:9] = np.nan
    columns = {"a (mT)": a, "b (V)": np.cos(np.arange(240.0)), "run": np.zeros(240)}
    with raises("nan-input", "2 NaN in input 'a (mT)', rows 8 to 9"):
        rig(columns=columns, groups=None)
    filled = rig(columns=columns, groups=None, nan="interpolate")
    # The clock's steps differ in their last digits.
    np.testing.assert_allclose(filled.columns["a (mT)"], np.arange(240.0), rtol=1e-12)
    short = columns | {"a (mT)": np.zeros(5)}
    refuses("length-mismatch", lambda: rig(columns=short, groups=None))
