"""Linear systems with hysteretic channels: steady states, motion in time, distortion, and fits."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from hysteresis import (
    BoucWen,
    BoucWenForce,
    Feedback,
    GeneralizedMaxwell,
    GeneralizedPlays,
    Oscillator,
    PrandtlIshlinskii,
    StopsAndPowers,
)
from identify import distortion, fit_feedback, fit_modes, periodic_test
from identify.internal import PeriodicTest
from tests.refusals import refuses
from tests.test_hysid.command import run
from tests.thorough import rest_thorough

PERIOD, DT = 512, 0.1
MASS, DAMPING, STIFFNESS = 2.0, 0.4, 3.0


def multisine(seed: int, rms: float, lines: range = range(1, 60), channels: int = 1) -> np.ndarray:
    """(samples, channels), one period."""
    rng = np.random.default_rng(seed)
    spectrum = np.zeros((PERIOD // 2 + 1, channels), complex)
    spectrum[lines] = np.exp(2j * np.pi * rng.random((len(lines), channels)))
    u = np.fft.irfft(spectrum, PERIOD, axis=0)
    return rms * u / u.std(0)


def mass_and_stop(limit: float, weight: float) -> Feedback:
    """m y'' + c y' + k y + weight stop(y) = u as one mode with one channel."""
    pole = np.roots([MASS, DAMPING, STIFFNESS])[0]
    pole = pole if pole.imag > 0 else pole.conjugate()
    entry = 1 / (2j * MASS * pole.imag)
    law = StopsAndPowers([limit], [weight])
    return Feedback([pole], [[entry, -entry]], [[1.0], [1.0]], np.zeros((2, 2)), 0.0, (law,), [0.0])


@cache
def oscillator_tests() -> tuple[PeriodicTest, ...]:
    """Three realisations of three levels of a mass with Bouc-Wen's force; one does not repeat."""
    plant = Oscillator(MASS, DAMPING, STIFFNESS, BoucWenForce(2.0, 1.5, 0.5), substeps=8)
    rng, found = np.random.default_rng(0), []
    for k, rms in enumerate(np.repeat([0.5, 1.0, 2.0], 3)):
        u = np.tile(multisine(k, rms), (5, 1))
        y = plant.displacement(DT * np.arange(len(u)), u[:, 0])
        y = y + 1e-3 * y.std() * rng.normal(size=len(y)) * (50 if k == 1 else 1)
        found.append(periodic_test(u, y, DT, settling=3))
    return tuple(found)


def test_a_mode_with_a_stop_is_a_mass_with_plays():
    """The same equation, integrated by Newmark's method in another model."""
    limit, weight = 0.3, 1.5
    plays = GeneralizedPlays([0.0, limit], [1.0, 1.0], [[-weight, weight], [weight, -weight]])
    u, more = multisine(0, 1.0, range(1, 25)), 8
    fine = np.fft.irfft(more * np.fft.rfft(u[:, 0]), more * PERIOD)
    t = DT / more * np.arange(8 * len(fine))
    plant = Oscillator(MASS, DAMPING, STIFFNESS, plays, substeps=4)
    y = plant.displacement(t, np.tile(fine, 8))[-len(fine) :: more]
    found = mass_and_stop(limit, weight).steady(u, DT, finer=more)[:, 0]
    # Newmark's steps of a period of 150 rows and force straight between them err by 1e-4 each.
    assert np.abs(found - y).max() < 5e-4 * y.std()


@pytest.mark.parametrize("law", [
    StopsAndPowers([0.3], [1.5], [0.1, 0.0, 0.2]), PrandtlIshlinskii([0.3], [1.0], 0.2),
    GeneralizedMaxwell(0.5, [1.0], [3.0]), BoucWen(1.0, 0.5, 0.4),
])  # fmt: skip
def test_a_steady_state_is_where_the_motion_ends(law):
    """With memory of reversals and of time."""
    model = replace(mass_and_stop(0.3, 1.5), channels=(law,))
    u = multisine(0, 1.0, range(1, 25))
    ends = model.simulate(np.tile(u, (9, 1)), DT)[-PERIOD:, 0]
    # A motion takes its input as straight within fine steps, and continues the last 32 samples by itself.
    assert np.abs(model.steady(u, DT)[:, 0] - ends)[:-40].max() < 5e-4 * ends.std()


def test_modes_of_a_linear_system_are_found():
    """Two modes, two inputs, three outputs, a delay: nothing is left."""
    rng = np.random.default_rng(4)
    poles = np.array([-0.05 + 1.5j, -0.1 + 4j])
    b, c = (rng.normal(size=s) + 1j * rng.normal(size=s) for s in ((2, 2), (3, 2)))
    truth = Feedback(poles, b, c, rng.normal(size=(3, 2)), 0.03)
    tests = []
    for k in range(4):
        u = multisine(10 + k, 1.0, range(1, 120), channels=2)
        tests.append(PeriodicTest(u, truth.steady(u, DT)[None], DT))
    fit = fit_feedback(tests, groups=0)
    assert fit.groups == ()
    assert fit.errors == fit.linear_errors
    assert np.isnan(fit.unseen)  # of a single level
    assert fit.errors[0] < 1e-3
    found = np.sort_complex(fit.model.poles)
    assert len(found) == len(poles)
    assert np.abs(found - np.sort_complex(poles)).max() < 1e-3


def test_a_fit_explains_what_modes_alone_leave():
    tests = oscillator_tests()
    fit = fit_feedback(tests, groups=1)
    assert (fit.left_out, fit.held_out) == ((1,), (2, 5, 8))
    assert np.allclose(fit.levels, [0.5, 1.0, 2.0], rtol=1e-6)
    assert max(fit.errors) < 0.12
    assert np.mean(fit.errors) < 0.25 * np.mean(fit.linear_errors)
    # A level that no test of the fit had: hardly worse than one that others showed.
    assert fit.errors[1] < fit.unseen < 1.5 * max(fit.errors)
    assert fit.screening[0].share > 0.5
    assert len(fit.groups) == 1
    moved = replace(fit.model, memory=20.0).simulate(np.tile(tests[4].u, (4, 1)), DT)[-PERIOD:]
    assert np.std(moved - fit.model.steady(tests[4].u, DT)) < 0.1 * np.std(moved)


def test_even_odd_and_noise_are_told_apart():
    """u^2 of odd lines lies in even lines alone; so many periods show the noise."""
    u, rng = multisine(5, 1.0, range(1, 100, 2)), np.random.default_rng(0)
    square = 0.1 * (u**2 - (u**2).mean())
    y = u + square + 0.01 * rng.normal(size=(64, PERIOD, 1))
    (row,) = distortion([PeriodicTest(u, y, DT)], bands=1)
    assert row.level == pytest.approx(1.0)
    assert row.linear == pytest.approx(1.0, rel=0.01)
    assert row.even == pytest.approx(square.std(), rel=0.02)
    assert row.odd < 0.002
    assert row.stochastic < 0.01
    # Of the mean of 64 periods.
    assert row.noise == pytest.approx(0.01 / 8, rel=0.1)


def test_a_drift_and_a_noisy_gauge_of_the_input_are_no_distortion():
    """Of ten times the output; and noise of 2 % in the input is in all lines, of which half are excited."""
    u, rng = np.tile(multisine(5, 1.0, range(1, 100, 2)), (8, 1)), np.random.default_rng(0)
    read = u + 0.02 * rng.normal(size=u.shape)
    test = periodic_test(read, 2 * u + np.linspace(0, 20, len(u))[:, None], DT, PERIOD)
    (row,) = distortion([test], bands=1)
    assert row.linear == pytest.approx(2.0, rel=1e-3)
    assert max(row.even, row.odd, row.noise) < 1e-9
    assert row.stochastic < 0.02


def test_one_realisation_of_a_sharp_resonance_says_that_it_is_smoothed():
    """A linear system has no stochastic part, and two realisations show none; one cannot tell it from a
    resonance that is sharper than a window of lines."""
    model = Feedback([-0.02 + 1.5j], [[-0.3j]], [[1.0]], [[0.0]])
    u = [multisine(k, 1.0, range(1, 100)) for k in range(2)]
    tests = [PeriodicTest(x, model.steady(x, DT)[None], DT) for x in u]
    (one,), (two,) = distortion(tests[:1], bands=1), distortion(tests, bands=1)
    assert not two.smoothed
    assert two.stochastic < 1e-6 * two.total
    assert one.smoothed
    assert one.stochastic > 0.01 * one.total


def test_nothing_stays_nothing():
    model, none = mass_and_stop(0.3, 1.5), np.zeros((PERIOD, 1))
    assert not model.steady(none, DT).any()
    assert not model.simulate(none, DT).any()
    # A step of the input is answered after its row, not on it.
    assert model.simulate(none + 1.0, DT)[0] == 0


def test_what_cannot_be_used_is_refused():
    u = multisine(0, 1.0)
    refuses("not-periodic", lambda: periodic_test(u, u, DT, settling=1))
    refuses("length-mismatch", lambda: periodic_test(u, u[1:], DT))
    one = PeriodicTest(u, u[None], DT)
    refuses("too-few-runs", lambda: fit_feedback([one]))
    refuses("length-mismatch", lambda: distortion([one, PeriodicTest(u[:100], u[None, :100], DT)]))
    refuses("parameter-out-of-bounds", lambda: Feedback([0.1 + 1j], [[1.0]], [[1.0]], [[0.0]]))
    strong = mass_and_stop(0.3, -500.0)
    refuses("diverged", lambda: strong.steady(u, DT))
    refuses("bad-option", lambda: replace(strong, levels=np.array([1.0])).simulate(u, DT))


def test_command_tells_distortion(tmp_path):
    rows = ["run,t,a,y"]
    for k in range(2):
        u = np.tile(multisine(k, 1.0, range(1, 60, 2))[:, 0], 2)
        rows += [f"{k},{row * DT:.1f},{x:.9g},{x + 0.1 * x * x:.9g}" for row, x in enumerate(u)]
    file = tmp_path / "shaker.csv"
    file.write_text("\n".join(rows))
    asked = ["--input", "a", "--output", "y", "--time", "t", "--group", "run", "--bands", "1"]
    (row,) = run("distortion", file, *asked, "--json").json()["rows"]
    assert row["output"] == "y"
    assert row["even"] > 10
    assert max(row["odd"], 1e6 * row["noise"]) < 1
    assert "sharp resonance" not in run("distortion", file, *asked).out
    # A list given in two options is one list: none of it is lost.
    both = run("distortion", file, *asked, "--output", "a", "--json").json()["rows"]
    assert [one["output"] for one in both] == ["y", "a"]
    file.write_text("\n".join(rows[: 1 + len(rows) // 2]))
    assert "sharp resonance" in run("distortion", file, *asked).out


def two_modes() -> Feedback:
    """One input, two outputs."""
    return Feedback([-0.05 + 1.5j, -0.1 + 4j], [[-0.3j], [0.2]], [[1, 1], [1, -0.5]], [[0.1], [0]])


@pytest.mark.parametrize("excitation", rest_thorough(["sweep", "noise", "blows"], 1))
def test_modes_are_found_from_any_record(excitation):
    """It begins and ends in the middle of the motion; the model predicts another run from rest."""
    truth, rng, rows = two_modes(), np.random.default_rng(1), 4000
    u = rng.normal(size=(rows, 1))
    if excitation == "sweep":
        u[:, 0] = np.sin(0.0002 * np.pi * np.arange(rows) ** 2 * DT)
    if excitation == "blows":
        u = np.where(rng.random((rows, 1)) < 0.01, 5.0 * rng.random((rows, 1)), 0.0)
    y = truth.simulate(u, DT)[500:]
    noisy = y + 0.01 * y.std(0) * rng.normal(size=y.shape)
    found = fit_modes(u[500:], noisy, DT)
    for pole in truth.poles:
        assert np.abs(found.poles - pole).min() < 2e-3 * abs(pole)
    new = rng.normal(size=(2000, 1))
    wanted = truth.simulate(new, DT)
    # Twice the noise: of noise as input modes at the edge of the band fit what is between the samples.
    assert (found.simulate(new, DT) - wanted).std() < 0.02 * wanted.std()


def test_an_output_of_noise_alone_hides_no_mode():
    """A sensor that is not connected: each output would count by its own size."""
    truth, rng = two_modes(), np.random.default_rng(1)

    def beside(y: np.ndarray) -> np.ndarray:
        y = y + 1e-3 * y.std(0) * rng.normal(size=y.shape)
        return np.column_stack([y, 1e-6 * rng.normal(size=(len(y), 2))])

    u = rng.normal(size=(400, 1))
    found = [fit_modes(u, beside(truth.simulate(u, DT)), DT)]
    tests = []
    for k in range(2):
        u = multisine(k, 1.0, range(1, 120))
        moved = np.tile(truth.steady(u, DT), (2, 1))
        tests.append(periodic_test(np.tile(u, (2, 1)), beside(moved), DT, PERIOD))
    found.append(fit_feedback(tests, groups=0).model)
    for model in found:
        for pole in truth.poles:
            assert np.abs(model.poles - pole).min() < 2e-3 * abs(pole)


def test_a_record_without_a_resonance_has_no_modes():
    rng = np.random.default_rng(0)
    for code, rows in (("nothing-fits", 500), ("too-few-rows", 20)):
        refuses(code, lambda n=rows: fit_modes(rng.normal(size=n), rng.normal(size=n), DT))
    sine = np.sin(np.arange(512) * np.pi / 16)
    refuses("no-excitation", lambda: fit_modes(sine, sine, DT))
