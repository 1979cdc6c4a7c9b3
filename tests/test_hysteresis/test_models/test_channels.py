"""Several channels: the map against its equation, and records that carry them."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hysteresis import ChannelMap, InputError, Record

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


@pytest.mark.parametrize(
    ("changes", "code"),
    [
        ({"values": np.zeros((3, 4))}, "length-mismatch"),
        ({"names": ("a", "b")}, "length-mismatch"),
        ({"nodes": np.zeros((3, 1)), "values": np.zeros((3, 1))}, "length-mismatch"),
        ({"nodes": np.zeros((3, 5))}, "parameter-out-of-bounds"),
    ],
)
def test_bad_arguments_are_refused(changes: dict[str, Any], code: str):
    good = made(0)
    arguments = {k: getattr(good, k) for k in ("nodes", "values", "offset", "names", "units")}
    with pytest.raises(InputError) as caught:
        ChannelMap(**(arguments | changes))
    assert caught.value.code == code


def rig(**options: Any) -> Record:
    t = 0.1 * np.arange(240)
    s = 0.5 - 0.5 * np.cos(2 * np.pi * t / 4.0)
    columns = {"a (mT)": 3 * s, "b (V)": 1 - s**2, "run": np.repeat([1.0, 2.0], 120)}
    arguments: dict[str, Any] = {
        "columns": columns,
        "channels": {"a (mT)": "mT", "b (V)": "V"},
        "groups": columns["run"],
    }
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
    with pytest.raises(InputError, match=r"2 NaN in input 'a \(mT\)', rows 8 to 9") as caught:
        rig(columns=columns, groups=None)
    assert caught.value.code == "nan-input"
    filled = rig(columns=columns, groups=None, nan="interpolate")
    # The clock's steps differ in their last digits.
    np.testing.assert_allclose(filled.columns["a (mT)"], np.arange(240.0), rtol=1e-12)
    short = columns | {"a (mT)": np.zeros(5)}
    with pytest.raises(InputError, match="length-mismatch"):
        rig(columns=short, groups=None)
