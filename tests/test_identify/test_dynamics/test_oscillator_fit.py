"""Oscillators found from records that another implementation of the benchmark made."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.signal import lfilter

import identify
from benchmarks._dynamics.plants import FINE, NOISE, RATE, Plant, multisine, steady, training
from hysteresis import Record
from identify.dynamics._linear_approximation import LinearApproximation, linear_approximation
from identify.dynamics._measured_motion import measured_motion, period_of
from identify.fitting._oscillator import misfit_of, warnings_of
from tests.refusals import raises, refuses

SAMPLES = 1024
TRUTH = [2.0, 10.0, 5e4, 5e4, 800.0, -1100.0]


def recorded(u: np.ndarray, y: np.ndarray, **options) -> Record:
    t = np.arange(len(u)) / RATE
    return Record.from_arrays(u, y, t, input_unit="N", output_unit="m", **options)


@cache
def record() -> Record:
    return recorded(*training(1, samples=SAMPLES, periods=4))


@cache
def found() -> identify.FitResult:
    return identify.fit(record(), "Oscillator(BoucWen)")


def true_steady() -> tuple[np.ndarray, np.ndarray]:
    return steady(Plant(), multisine(np.random.default_rng(99), SAMPLES), 1)


def test_a_class_that_is_known_is_found_without_start_values():
    fit = found()
    assert (fit.name, fit.detail.kind) == ("Oscillator(BoucWen)", "motion")
    assert fit.detail.chi2 == pytest.approx(1.0, abs=0.1)
    for parameter, wanted in zip(fit.parameters, TRUTH, strict=True):
        assert abs(parameter.value - wanted) < 4 * parameter.stderr, parameter.name
        assert parameter.stderr < 0.02 * abs(wanted)
    assert [p.unit for p in fit.parameters][:3] == ["kg", "N * s / m", "N / m"]
    assert fit.noise.sigma == pytest.approx(NOISE, rel=0.03)


def test_it_predicts_an_unseen_multisine_far_below_the_noise():
    u, y = true_steady()
    motion = found().detail
    assert type(motion).__name__ == "Motion"
    predicted = motion.recorded.steady(recorded(u, y))
    assert np.sqrt(np.mean((predicted - y) ** 2)) < NOISE / 20
    assert motion.recorded.stages == (2, 2, 5)
    rest = Plant().moved(np.tile(multisine(np.random.default_rng(99), SAMPLES), 2))[::FINE]
    from_rest = motion.recorded.from_rest(recorded(np.tile(u, 2), rest))
    assert np.sqrt(np.mean((from_rest - rest) ** 2)) < NOISE


def test_what_is_saved_predicts_the_same(tmp_path):
    fit = found()
    again = identify.load(identify.save(fit, tmp_path / "fit"))
    np.testing.assert_array_equal(again.predict(record()), fit.predict(record()))
    u, y = true_steady()
    other = recorded(u, y)
    np.testing.assert_array_equal(again.predict(other), fit.predict(other))
    assert again.detail.words() == fit.detail.words()


def test_held_out_periods_are_predicted_in_their_phase():
    cut = int(2.5 * SAMPLES)
    train, test = record().split_tail(1 - cut / len(record()))
    fit = identify.fit(train, "Oscillator(BoucWen)", test=test)
    assert fit.metrics["test"].rmse == pytest.approx(NOISE, rel=0.05)
    assert fit.verdict.level == "PASS", fit.verdict


@cache
def short() -> identify.FitResult:
    return identify.fit(recorded(*training(2, rows=500)), "Oscillator(BoucWen)")


def test_a_short_record_without_a_period_gets_its_state_too():
    fit = short()
    assert (type(fit.detail).__name__, fit.detail.recorded.period) == ("Motion", 0)
    assert fit.detail.chi2 == pytest.approx(1.0, abs=0.25)
    assert fit.noise.sigma == pytest.approx(NOISE, rel=0.1)


@pytest.mark.thorough
def test_a_posterior_agrees_with_the_standard_errors_and_resumes(tmp_path):
    """Also where the initial state is free, whose information is decades from that on a stiffness."""
    options = {"ensembles": 2, "walkers": 20}
    posterior = identify.sample(short(), steps=30, **options)
    sigma = {"sigma": (short().noise.sigma, None)}
    wanted = {p.name: (p.value, p.stderr) for p in short().parameters} | sigma
    assert set(posterior.names) == set(wanted)
    for one in posterior.summaries:
        value, error = wanted[one.name]
        error = one.sd if error is None else error
        assert one.sd == pytest.approx(error, rel=0.35), one.name
        assert abs(one.mean - value) < 0.5 * error, one.name
    identify.sample(short(), steps=20, checkpoint=tmp_path / "chains.npz", **options)
    again = identify.sample(
        short(), steps=30, checkpoint=tmp_path / "chains.npz", resume=True, **options
    )
    np.testing.assert_array_equal(again.draws, posterior.draws)


def test_a_design_predicts_the_errors_of_a_fit_and_prefers_what_moves_more():
    fit, options = found(), {"levels": (25.0, 50.0), "rows": SAMPLES}
    band = [(5.0, 150.0), (20.0, 79.0)]
    designs = identify.design_excitation(fit, bands=band, **options)
    assert [one.hysteresis for one in designs] == sorted(one.hysteresis for one in designs)
    assert designs[0].level == 50.0
    (own,) = (one for one in designs if (one.low, one.level) == (5.0, 50.0))
    # As the record of the fit, which has four periods.
    for parameter, relative in zip(
        fit.parameters, (own.mass, own.damping, own.stiffness), strict=False
    ):
        assert parameter.stderr / parameter.value == pytest.approx(relative / 2, rel=0.15)
    least = identify.design_excitation(fit, bands=band, largest=own.displacement / 1.5, **options)
    assert {one.level for one in least} == {25.0}
    assert not any(one.beyond for one in least)
    for bad, code in (
        ({"largest": 1e-9}, "no-design"),
        ({"levels": (-1.0,)}, "bad-option"),
        ({"bands": [(300.0, 400.0)]}, "bad-option"),
        ({"rows": 10}, "bad-option"),
    ):
        with raises(code):
            identify.design_excitation(fit, **({"bands": band} | options | bad))


def test_coloured_noise_is_estimated_from_the_periods():
    period = multisine(np.random.default_rng(1), 1024)
    u, y = steady(Plant(), period, 4)
    white = np.random.default_rng(3).normal(size=len(y) + 500)
    colored = lfilter([1.0], [1.0, -0.9], white)[500:]
    record = recorded(u, y + NOISE / colored.std() * colored)
    motion = measured_motion(record)
    assert motion.color[5] > 10 * motion.color[-5]  # 19 times in theory
    assert "coloured-noise" in {note.code for note in motion.notes}
    fit = identify.fit(record, "Oscillator(BoucWen)")
    assert fit.detail.chi2 == pytest.approx(1.0, abs=0.15)
    for parameter, wanted in zip(fit.parameters, TRUTH, strict=True):
        assert abs(parameter.value - wanted) < 4 * parameter.stderr, parameter.name
    assert measured_motion(recorded(*training(1, samples=1024, periods=4))).color is None


def test_a_record_without_noise_is_explained():
    u, y = true_steady()
    fit = identify.fit(recorded(u, y), "Oscillator(BoucWen)", period=SAMPLES)
    assert fit.blocks is None  # of a single period nothing is held out
    assert [p.value for p in fit.parameters] == pytest.approx(TRUTH, rel=1e-3)


@pytest.mark.thorough
def test_a_wrong_class_is_said_to_be_wrong():
    other = recorded(*training(1, "iwan", 3, samples=SAMPLES))
    fit = identify.fit(other, "Oscillator(BoucWen)", starts=12)
    assert fit.detail.kind == "motion"
    assert fit.detail.chi2 > 10
    said = fit.verdict.reasons[fit.verdict.codes.index("wrong-class")]
    left = np.sqrt(fit.detail.chi2 - 1) * measured_motion(other).sigma
    assert f"is {fit.detail.chi2:.3g} where" in said
    assert f"wrong by {left:.3g} m rms." in said


def test_a_damper_that_gives_energy_is_told():
    mass, damping, *rest = found().parameters
    for value, codes in ((10.0, set()), (-10.0, {"negative-damping"})):
        changed = replace(found(), parameters=(mass, damping._replace(value=value), *rest))
        notes = misfit_of(changed, measured_motion(record()), found().detail)
        assert {note.code for note in notes} == codes


def test_the_period_is_found_and_a_wrong_one_is_refused():
    u = np.asarray(record().input)
    assert period_of(u) == SAMPLES
    assert period_of(u + 0.005 * u.std() * np.random.default_rng(0).normal(size=len(u))) == SAMPLES
    assert period_of(u[: int(1.5 * SAMPLES)]) == 0
    assert period_of(np.cumsum(np.random.default_rng(1).normal(size=500))) == 0
    refuses("not-periodic", lambda: measured_motion(record(), SAMPLES + 3), str(SAMPLES))


def test_a_settling_period_is_left_out():
    period = multisine(np.random.default_rng(5), 1024)
    y = Plant().moved(np.tile(period, 4))[::FINE]
    noise = NOISE * np.random.default_rng(6).normal(size=len(y))
    motion = measured_motion(recorded(np.tile(period, 4)[::FINE], y + noise))
    assert motion.rows == (1024, 4096)
    assert "transient-period" in {note.code for note in motion.notes}


def test_clocks_and_forces_that_cannot_be_used_are_refused():
    t = np.asarray(record().time).copy()
    t[1000:] += 0.05
    with raises("uneven-clock", "line 1001"):
        identify.fit(replace(record(), time=t), "Oscillator")
    for change, code in (
        ({"input": np.ones(len(record()))}, "constant-input"),
        ({"time": None}, "no-time"),
    ):
        refuses(code, lambda change=change: identify.fit(replace(record(), **change), "Oscillator"))


def test_a_resonance_that_is_not_excited_is_said_to_be():
    period = multisine(np.random.default_rng(3), SAMPLES, low=80.0, high=150.0)
    u, y = steady(Plant(), period, 2)
    refuses("no-excitation", lambda: identify.fit(recorded(u, y + 1e-8), "Oscillator"))


def test_a_spring_without_a_mass_is_said_to_be():
    u = np.asarray(record().input)
    noise = 1e-9 * np.random.default_rng(0).normal(size=len(u))
    refuses("no-excitation", lambda: identify.fit(recorded(u, u / 5e4 + noise), "Oscillator"))


def test_coarse_records_are_warned_of():
    """Too few steps a cycle of the resonance, too few samples, a force up to the Nyquist frequency."""
    motion = measured_motion(record())
    linear = linear_approximation(motion)

    def codes(changed: LinearApproximation, oversampling: int = 20) -> set[str]:
        return {note.code for note in warnings_of(motion, changed, oversampling)}

    assert codes(linear) == set()
    assert codes(linear, 1) == {"coarse-integration"}
    assert codes(linear._replace(frequencies=2.4 * linear.frequencies)) == {"aliasing"}
    assert codes(linear._replace(stiffness=16 * linear.stiffness)) == {"coarse-sampling"}


@pytest.mark.parametrize(("model", "options", "code"), [
    ("Oscillator(Maxwell)", {}, "unknown-model"),
    ("Oscillator,Burgers", {}, "bad-option"),
    ("Burgers", {"period": 100}, "bad-option"),
    ("Oscillator", {"oversampling": 0}, "bad-option"),
    ("Oscillator", {"period": 5}, "bad-option"),
])  # fmt: skip
def test_options_that_do_not_fit_are_refused(model: str, options: dict[str, int], code: str):
    refuses(code, lambda: identify.fit(record(), model, **options))
