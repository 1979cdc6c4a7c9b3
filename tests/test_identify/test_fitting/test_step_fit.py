"""Fits of creep and relaxation: known elements come back, in the rig's units, and survive a folder."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import identify
from hysteresis import GeneralizedKelvinVoigt, GeneralizedMaxwell, Record
from identify import fit_step
from identify.internal import kind_of, told_by_the_change
from tests.refusals import refuses
from tests.thorough import rest_thorough

CREEP = GeneralizedKelvinVoigt(2.0, [1.0, 4.0], [0.5, 80.0], 500.0)
RELAXING = GeneralizedMaxwell(0.5, [1.0, 4.0], [0.4, 20.0])
T = np.geomspace(0.02, 200.0, 240)
FORCE = -3.0
"""A press, as many rigs sign it."""

PRESSED = {"input_name": "force", "output_name": "x", "input_unit": "N", "output_unit": "mm"}
STRETCHED = {"input_name": "x", "output_name": "force", "input_unit": "mm", "output_unit": "N"}


def record(t: np.ndarray, y: np.ndarray, step: float = FORCE, **names: Any) -> Record:
    return Record.from_arrays(np.full(len(t), step), y, t, **(names or PRESSED))


def creeping(seed: int = 0, size: float = 0.002) -> np.ndarray:
    noise = 1 + size * np.random.default_rng(seed).normal(size=len(T))
    return FORCE * np.asarray(CREEP.creep_compliance(T)) * noise


def test_creep_under_a_press():
    fit = fit_step(record(T, creeping()))
    assert isinstance(fit.model, GeneralizedKelvinVoigt)
    assert fit.name == "GeneralizedKelvinVoigt of order 2"
    found = {p.name: p for p in fit.parameters}
    assert list(found) == ["E0", "eta0", "E1", "eta1", "E2", "eta2"]
    truth = {"E0": 2.0, "eta0": 500.0, "E1": 1.0, "eta1": 0.5, "E2": 4.0, "eta2": 80.0}
    for name, value in truth.items():
        error = found[name].stderr
        assert found[name].status == "free"
        # Four standard errors: a chance of one in three thousand for six of them.
        assert abs(found[name].value - value) < 4 * error < value
    assert (found["E1"].unit, found["eta1"].unit) == ("N / mm", "N * s / mm")
    assert fit.covariance.shape == (6, 6)
    errors = [p.stderr or 0.0 for p in fit.parameters]
    np.testing.assert_allclose(np.sqrt(np.diagonal(fit.covariance)), errors)
    assert [c.name for c in fit.candidates[:1]] == [fit.name]
    scores = [c.score for c in fit.candidates]
    assert scores == sorted(scores)


def test_relaxation():
    y = 0.2 * np.asarray(RELAXING.relaxation_modulus(T))
    noise = 1 + 0.002 * np.random.default_rng(1).normal(size=len(T))
    fit = fit_step(record(T, y * noise, 0.2, **STRETCHED))
    assert isinstance(fit.model, GeneralizedMaxwell)
    found = {p.name: p.value for p in fit.parameters}
    assert list(found) == ["E_inf", "E1", "tau1", "E2", "tau2"]
    np.testing.assert_allclose([*found.values()], [0.5, 1.0, 0.4, 4.0, 20.0], rtol=0.1)


def test_a_liquid_has_no_spring():
    y = np.asarray(GeneralizedMaxwell(0.0, [1.0, 4.0], [0.4, 20.0]).relaxation_modulus(T))
    fit = fit_step(record(T[T < 100], y[T < 100], 1.0, **STRETCHED))
    spring = next(p for p in fit.parameters if p.name == "E_inf")
    # Without noise what is left of a spring is the normal equations' rounding.
    assert spring.status == "at bound" or spring.value < 1e-3


def test_elements_outside_the_record_are_a_spring_or_a_dashpot():
    slow = GeneralizedKelvinVoigt(2.0, [1.0, 0.01], [0.5, 4.0])
    t = np.geomspace(0.02, 20.0, 120)
    noise = 1 + 1e-3 * np.random.default_rng(0).normal(size=len(t))
    fit = fit_step(record(t, FORCE * np.asarray(slow.creep_compliance(t)) * noise))
    assert [p.status for p in fit.parameters if p.name in ("E1", "eta1")] == ["free", "free"]
    found = fit.detail.spectrum
    tau = [float(e) for e in np.asarray(found.model.eta / found.model.E)]
    beyond = [k for k, x in enumerate(tau, 1) if x >= found.span]
    names = {p.name: p for p in fit.parameters}
    # A slow element flows: as a dashpot of its own, or as one whose stiffness no row tells.
    assert "eta0" in names or beyond
    for k in beyond:
        assert (names[f"E{k}"].status, names[f"E{k}"].stderr) == ("unidentified", None)
        assert any("identifiable only as a dashpot" in note for note in fit.notes)


def test_a_folder_keeps_it(tmp_path: Path):
    fit = fit_step(record(T, creeping()), test_tail=0.2)
    identify.save(fit, tmp_path / "fit")
    loaded = identify.load(tmp_path / "fit")
    assert loaded.parameters == fit.parameters
    assert [note.code for note in loaded.train.history] == [n.code for n in fit.train.history]
    assert "step-before-first-row" in [note.code for note in loaded.train.history]
    old, new = fit.detail.spectrum, loaded.detail.spectrum
    assert (new.table, new.order, new.kind, new.notes) == (
        old.table, old.order, old.kind, old.notes,
    )  # fmt: skip
    for mine, kept in zip(old.predict(T), new.predict(T), strict=True):
        np.testing.assert_array_equal(mine, kept)
    refuses("no-posterior", lambda: identify.sample(loaded))


GOOD = creeping()


@pytest.mark.parametrize(("given", "code"), [
    (record(T, GOOD, 0.0), "not-a-step"),
    (Record.from_arrays(T, GOOD, T), "not-a-step"),
    (Record.from_arrays(np.ones(len(T)), GOOD), "no-time"),
    (Record.from_arrays(np.ones(len(T)), -GOOD, T, T > 1), "not-a-step"),
    (record(T - 1.0, GOOD), "not-a-step"),
    (record(T, -GOOD), "not-a-step"),
    (record(T[:7], GOOD[:7]), "too-few-rows"),
    (record(T, np.full(len(T), FORCE)), "no-excitation"),
], ids=lambda x: x if isinstance(x, str) else "")  # fmt: skip
def test_what_is_no_step(given: Record, code: str):
    refuses(code, lambda: fit_step(given))


@pytest.mark.parametrize("truth", [CREEP, RELAXING], ids=["creep", "relaxation"])
@pytest.mark.parametrize(
    ("ramp", "smooth"),
    rest_thorough([(2.0, False), (0.2, False), (8.0, False), (0.2, True), (2.0, True)], 1),
)
def test_the_way_to_a_hold_is_in_the_model(truth: Any, ramp: float, smooth: bool) -> None:
    """Whatever the ramp, the strengths are those of a step, and the errors of short branches say when the
    ramp hides them."""
    t = np.arange(0.0, ramp + 200.0, 0.05)
    share = np.minimum(t / ramp, 1.0)
    u = FORCE * (np.sin(np.pi / 2 * share) ** 2 if smooth else share)
    y = np.asarray(truth.simulate(t, u))
    y = y * (1 + 1e-3 * np.random.default_rng(2).normal(size=len(t)))
    found = fit_step(Record.from_arrays(u, y, t - 7.0))
    told = {p.name: p for p in found.parameters}
    one = told["E0" if truth.creeps else "E_inf"]
    # Four standard errors, as above.
    assert one.stderr is None or abs(one.value - (2.0 if truth.creeps else 0.5)) < 4 * one.stderr
    for k, value in enumerate(np.asarray(truth.E), start=1):
        one = told[f"E{k}"]
        assert abs(one.value - value) < 4 * one.stderr
    rows = found.used
    # Rows of a long way are thinned for the spectrum: far less than the noise of 1e-3.
    wanted = (found.train.output + found.residuals)[rows]
    np.testing.assert_allclose(found.predict(found.train)[rows], wanted, rtol=1e-5)


def test_a_master_curve_has_a_time_constant_for_each_decade() -> None:
    """Twelve decades of time: eight time constants leave 1.4 % of the reading."""
    tau = 10.0 ** np.arange(-1, 11)
    truth = GeneralizedMaxwell(1.0, 3.0 * np.exp(-0.1 * (np.arange(12) - 5) ** 2) + 0.3, tau)
    t = np.geomspace(0.01, 1e11, 120)
    y = np.asarray(truth.relaxation_modulus(t))
    y = y * (1 + 0.001 * np.random.default_rng(3).normal(size=len(t)))
    record = Record.from_arrays(np.ones(len(t)), y, t)
    dense = fit_step(record)
    # Four terms a decade between which a sharp one lies add as much as the noise.
    assert dense.metrics["train"].relative_percent < 0.16
    assert dense.name == f"GeneralizedMaxwell of {dense.detail.spectrum.order} log-spaced terms"
    series = fit_step(record, terms=12)
    assert series.metrics["train"].relative_percent < 0.11
    np.testing.assert_allclose(np.log10(series.model.tau), np.arange(-1, 11), atol=0.1)


def test_kind_is_told_by_what_is_held_and_else_by_the_change():
    """A load that rises under a held deformation swells or is still loaded: it has no spectrum."""
    u = np.full(len(T), FORCE)
    up, down = GOOD, GOOD[::-1]
    for units, rises, falls in (
        (("N", "mm"), "creep", None), (("MPa", "percent"), "creep", None),
        (("mm", "N"), None, "relaxation"), (("mm/mm", "kPa"), None, "relaxation"),
        (("N", "V"), "creep", "relaxation"),
        (("1", "1"), "creep", "relaxation"),
    ):  # fmt: skip
        for y, kind in ((up, rises), (down, falls)):
            held = Record.from_arrays(u, y, T, input_unit=units[0], output_unit=units[1])
            if kind is not None:
                assert kind_of(held) == kind
                said = told_by_the_change(held, kind)
                assert [note.code for note in said] == ["kind-by-change"] * (units[1] in "1V")
                continue
            refuses("not-a-step", lambda held=held: kind_of(held), "neither creep")
