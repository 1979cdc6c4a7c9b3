"""Force estimators without JAX are the JAX ones, to a billionth of the largest force."""

import json
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np
import pytest

from compensate import Quantity, Status, invert
from compensate.internal import BackwardsModel, ForceEstimator
from compensate.microchannel import export_force
from compensate.runtime import FileError, load
from hysteresis import AbstractModel, GeneralizedMaxwell, InputError, Preisach, Scaled, Series, Sum
from hysteresis.curves import PolynomialCurve
from hysteresis.internal import StaircaseNetwork
from hysteresis.preisach import GridDensity
from hysteresis.rigs import MicrochannelRig
from tests.c_harness import checksum
from tests.refusals import raises

RECORD = MicrochannelRig(seed=11).cnc_loops(300)
T, F = RECORD.time, RECORD.force[:, 0]
ONE, TWO = RECORD.reading[:, 0], RECORD.reading
HIGH = 8.0


class Case(NamedTuple):
    """An estimator and the readings it gets."""

    estimator: ForceEstimator
    readings: np.ndarray

    @property
    def channels(self) -> list[Quantity]:
        count = 1 if self.readings.ndim == 1 else self.readings.shape[1]
        return [Quantity(f"layer {k + 1}", "V") for k in range(count)]

    def export(self, folder: Path) -> Path:
        file = folder / "force.json"
        return export_force(self.estimator, file, self.readings, times=T, channels=self.channels)


def network(readings: np.ndarray, **options: Any) -> StaircaseNetwork:
    hidden = {"thresholds": (0.1, 0.4), "lags": (0.2, 5.0), "hidden": (8, 4)}
    return StaircaseNetwork.random([readings], [F], [T], jax.random.key(0), **(hidden | options))


@cache
def case(name: str) -> Case:
    two = {"rest": (0.02, -0.01), "scale": (1.0, 0.5)}
    relays = Preisach(GridDensity(0.0, 9.0, np.tril(np.full((6, 6), 0.05))), offset=1.0)
    lag = GeneralizedMaxwell(1.0, [0.1], [2.0])
    sensor = Series([relays, Scaled(lag, 1.5, 0.1)])
    models: dict[str, tuple[AbstractModel, np.ndarray]] = {
        "network": (network(ONE), ONE),
        "network without time": (network(ONE, lags=()), ONE),
        "network of two channels": (network(TWO, **two), TWO),
        "mean of networks": (StaircaseNetwork.mean([network(ONE), network(ONE)]), ONE),
        "chain": (Series([PolynomialCurve([-0.1, -1.0], -1.0, 1.0), lag, relays]), -ONE),
        "backwards": (BackwardsModel(invert(sensor)), ONE),
    }
    model, readings = models[name]
    several = readings.ndim > 1
    low, high = (readings.min(0) + 0.1, readings.max(0) - 0.3)
    limits = (tuple(low), tuple(high)) if several else (float(low), float(high))
    return Case(ForceEstimator(model, 0.05, HIGH, *limits), readings)


NAMES = (
    "network", "network without time", "network of two channels", "mean of networks", "chain",
    "backwards",
)  # fmt: skip
every = pytest.mark.parametrize("name", NAMES)


def spoilt(readings: np.ndarray) -> np.ndarray:
    """With samples that are none, in the last channel."""
    z = readings.copy()
    column = z if z.ndim == 1 else z[:, -1]
    column[[20, 21, 90]] = [np.nan, np.inf, -np.inf]
    return z


@every
def test_plain_python_is_the_same(name: str, tmp_path: Path):
    one = case(name)
    runtime, z = load(one.export(tmp_path)), spoilt(one.readings)
    wanted = one.estimator.simulate(T, z)
    for _ in range(2):  # a second time after a reset
        steps = np.diff(T, prepend=0.0).tolist()
        found = [runtime.step(dt, y) for y, dt in zip(z.tolist(), steps, strict=True)]
        value, status, deviation = (np.array(part) for part in zip(*found, strict=True))
        np.testing.assert_allclose(value, wanted.value, rtol=0, atol=1e-9 * HIGH)
        np.testing.assert_array_equal(status, wanted.status)
        assert (deviation == 0.05).all()
        runtime.reset()
    single = z.astype(np.float32)  # numbers of single precision do not make it single
    both = ([runtime.step(0.1, y).value for y in x] for x in (single, single.astype(float)))
    first = next(both)
    runtime.reset()
    assert first == next(both)
    assert {Status.OK, Status.EXTRAPOLATED, Status.INVALID} <= set(status.tolist())


def test_what_the_file_says_of_itself(tmp_path: Path):
    runtime = load(case("network of two channels").export(tmp_path))
    assert [c["name"] for c in runtime.channels] == ["layer 1", "layer 2"]
    assert runtime.estimate == {"name": "force", "unit": "N"}
    assert (runtime.title, runtime.high, runtime.rates) == ("StaircaseNetwork", HIGH, True)
    with pytest.raises(ValueError, match="1 readings for 2 channels"):
        runtime.step(0.1, 1.0)
    with pytest.raises(TypeError, match=r"step\(dt, reading\)"):
        runtime.step([1.0, 1.0])
    assert load(case("network without time").export(tmp_path)).step(0.1, 1.0).status in Status


def change(file: Path, name: str, value: Any, *, sealed: bool = True) -> None:
    document = json.loads(file.read_text())
    document[name] = value
    if sealed:
        document["checksum"] = checksum(document)
    file.write_text(json.dumps(document))


def test_files_that_cannot_be_trusted_are_refused(tmp_path: Path):
    file = case("network").export(tmp_path)
    model = json.loads(file.read_text())["model"]
    words = [["exit()"] * len(bias) for bias in model["biases"]]
    spoils = {
        "changed since": ("high", 9.0, False),
        "written in format 2": ("schema", 2, True),
        "forces inf off": ("limits", [[None, None]], True),
        "cannot be run (no model 'code')": ("model", {"kind": "code"}, True),
        "a weight is not finite": ("model", model | {"biases": [[float("inf")]] * 3}, True),
        "could not convert string": ("model", model | {"biases": words}, True),
    }
    for words, (name, value, sealed) in spoils.items():
        case("network").export(tmp_path)
        change(file, name, value, sealed=sealed)
        with pytest.raises(FileError) as refused:
            load(file)
        assert words in str(refused.value)
    change(case("network").export(tmp_path), "kind", "hysid armor")
    with pytest.raises(FileError, match="cannot be run"):
        load(file)
    with pytest.raises(FileError, match="No such file"):
        load(tmp_path / "none.json")


def test_what_cannot_be_exported_is_refused(tmp_path: Path):
    one, file = case("network"), tmp_path / "force.json"
    faults = {
        "no-rows": (one.estimator, ONE[:1], T[:1], one.channels),
        "no-time": (one.estimator, ONE, None, one.channels),
        "wrong-channels": (one.estimator, ONE, T, one.channels * 2),
        "not-exportable": (ForceEstimator(Sum([network(ONE)]), 0.1, HIGH), ONE, T, one.channels),
    }
    for code, (estimator, readings, times, channels) in faults.items():
        with raises(code):
            export_force(estimator, file, readings, times=times, channels=channels)
    with jax.enable_x64(False), pytest.raises(InputError, match="single-precision"):
        one.export(tmp_path)
    assert not file.exists()
