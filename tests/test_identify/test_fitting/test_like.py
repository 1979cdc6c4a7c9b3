"""A new specimen like earlier ones: a mixture of their fits, known from a cycle."""

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from compensate import invert
from hysteresis import LinearSponge, Mixture, MonotoneCurve, PrandtlIshlinskii, Record, Sum
from identify import FitResult, fit, load, save
from tests.refusals import refuses
from tests.test_hysid.command import run

NOISE = 0.003
QUICK: Any = {"noise": "gaussian", "starts": 1}


def pressed(stiff: float, lossy: float, cycles: float = 3.0, seed: int = 0) -> Record:
    """Cycles of a specimen that is a stiffening curve and a loop, each of its own size."""
    t = np.arange(0.0, cycles, 0.01)
    u = 2.0 - 2.0 * np.cos(2 * np.pi * t)
    curve = MonotoneCurve.even(0.0, 4.0, stiff * np.array([0.1, 0.2, 0.4, 0.9]), 0.0)
    loops = PrandtlIshlinskii([0.2, 0.6, 1.2], lossy * np.array([0.2, 0.1, 0.1]), 0.01)
    y = np.asarray(Sum(curve, loops).simulate(None, u))
    y = y + NOISE * np.random.default_rng(seed).standard_normal(len(y))
    return Record.from_arrays(u, y, t, input_unit="mm", output_unit="N")


NEW = pressed(1.2, 1.4, seed=7)


@cache
def earlier() -> tuple[FitResult, ...]:
    """Three specimens, fitted to all their cycles."""
    known = ((1.0, 1.0), (1.6, 1.2), (0.8, 1.6))
    return tuple(fit(pressed(*one, seed=k), "Composition") for k, one in enumerate(known))


@cache
def mixed() -> FitResult:
    """A new specimen, of which half a cycle is known."""
    return fit(NEW.take_rows(0, 60), "Composition", like=earlier())  # up, and a little back


def error(found: FitResult, whole: Record) -> float:
    """Rms in newtons over the cycles after the first."""
    later = whole.cycle > 1
    return float(np.sqrt(np.mean((found.predict(whole) - whole.output)[later] ** 2)))


def test_half_a_cycle_and_earlier_specimens_tell_the_whole_loop() -> None:
    alone = next(one for one in mixed().candidates if not isinstance(one.model, Mixture))
    assert isinstance(mixed().model, Mixture)
    assert mixed().name == "mixture of 3 earlier fits"
    assert "Prior of the weights" in mixed().notes[0]
    assert error(mixed(), NEW) < 2 * NOISE  # the mixture of the three is exact but for their noise
    assert error(mixed(), NEW) < 0.3 * error(alone, NEW)


@pytest.mark.thorough
def test_many_cycles_are_ranked_like_every_model() -> None:
    unlike = pressed(0.3, 6.0, seed=8)  # no mixture of the others
    found = fit(unlike, "Composition", like=earlier())
    assert not isinstance(found.model, Mixture)
    assert any(isinstance(one.model, Mixture) for one in found.candidates)


@pytest.mark.thorough
def test_specimens_that_do_not_tell_each_other_are_left_out() -> None:
    random, records = np.random.default_rng(3), []
    for _ in range(3):
        one = pressed(1.0, 1.0)
        turned = np.where(one.cycle <= 1, one.output, random.uniform(-2, 2) * one.output)
        units = {"input_unit": "mm", "output_unit": "N"}
        records.append(Record.from_arrays(one.input, turned, one.time, **units))
    fits = [fit(one, "LinearSponge") for one in records]
    found = fit(pressed(1.2, 1.4).take_rows(0, 60), "LinearSponge", like=fits)
    assert not isinstance(found.model, Mixture)
    assert "[not-comparable]" in found.skipped["mixture of 3 earlier fits"]


def test_other_quantities_are_refused() -> None:
    few = pressed(1.2, 1.4).take_rows(0, 60)
    volts = Record.from_arrays(few.input, few.output, few.time, input_unit="mm", output_unit="V")
    found = fit(volts, "LinearSponge", like=earlier(), **QUICK)
    assert "[wrong-unit]" in found.skipped["mixture of 3 earlier fits"]
    found = fit(replace(few, time_unit="ms"), "LinearSponge", like=earlier(), **QUICK)
    assert "time is in ms" in found.skipped["mixture of 3 earlier fits"]


def test_fits_of_the_same_rows_are_refused() -> None:
    """Rows held out do not judge a model that has seen them, and a specimen given twice is one."""
    new = replace(NEW, sha256="new")
    seen, first = (
        fit(one, "LinearSponge", **QUICK) for one in (new, replace(pressed(1.0, 1.0), sha256="one"))
    )
    asks: Any = {"like": [first, seen], "test_cycles": 1, **QUICK}
    refuses("given-twice", lambda: fit(new, "LinearSponge", **asks), "of these rows")
    other = replace(pressed(0.8, 1.6), sha256="other")
    refuses("given-twice", lambda: fit(other, "LinearSponge", like=[first, first], **QUICK))
    found = fit(other, "LinearSponge", like=[first, seen], **QUICK)
    assert "mixture of 2 earlier fits" in {*found.skipped, *(c.name for c in found.candidates)}


def test_weights_of_another_number_are_refused() -> None:
    refuses("bad-parts", lambda: Mixture([LinearSponge(1.0)], [0.5, 0.5]))


def test_it_is_kept_and_inverted(tmp_path: Path) -> None:
    save(mixed(), tmp_path / "fit")
    again = load(tmp_path / "fit")
    np.testing.assert_array_equal(again.predict(NEW), mixed().predict(NEW))
    found = invert(again.model).simulate(NEW.time, again.predict(NEW))
    assert np.abs(np.asarray(found.value) - NEW.input)[1:].max() < 1e-5


def test_the_command_line_takes_folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    few = NEW.take_rows(0, 60)
    table = np.column_stack([few.time, few.input, few.output])
    np.savetxt("new.csv", table, "%.5f", ",", header="time (s),input (mm),output (N)", comments="")
    for k, stiff in enumerate((1.0, 1.6, 0.8)):
        save(fit(pressed(stiff, 1.0, seed=k), "LinearSponge", **QUICK), f"old{k}")
    done = run("fit", "new.csv", "--input", "input (mm)", "--output", "output (N)", "--time", "time (s)",
               "--model", "LinearSponge", "--like", "old0,old1,old2", "--noise", "gaussian", "--starts", 2,
               "--out", "out")  # fmt: skip
    assert done.code == 0, done.err
    assert "mixture of 3 earlier fits" in load("out").skipped  # these lines do not tell each other
