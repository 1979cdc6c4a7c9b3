"""Fits: recovery from far starts, against lmfit, ranking, verdicts, and what is kept."""

import numpy as np
import pytest

from benchmarks import _other_rigs as rigs
from benchmarks._accuracy.motions import Path
from hysteresis import Burgers, Preisach, Record
from hysteresis.rigs import SpongeRig
from identify import FitResult, fit, load, save
from identify.internal import to_json
from tests.refusals import refuses
from tests.thorough import rest_thorough


def creep_record(noise=0.0, seed: int = 0, leading: bool = False) -> tuple[Record, Burgers]:
    """Uneven steps, loads and rests, three sequences' worth of cycles."""
    random = np.random.default_rng(seed)
    t = np.cumsum(random.uniform(0.1, 0.5, 400))
    u = 5 * np.interp(t, np.linspace(0, t[-1], 13), np.tile([0.0, 1.0, 1.0, 0.3], 4)[:13])
    truth = Burgers(2.0, 60.0, 1.0, 5.0, 0.2, leading=leading)
    y = np.asarray(truth.simulate(t, u))
    y = y + random.normal(0, noise * np.ptp(y), len(y))
    units = {"input_unit": "N", "output_unit": "mm", "time_unit": "s"}
    return Record.from_arrays(u, y, t, **units), truth  # type: ignore[arg-type]


@pytest.mark.parametrize("leading", rest_thorough([False, True], 1))
def test_burgers_is_recovered_from_a_decade_away(leading: bool) -> None:
    record, truth = creep_record(leading=leading)
    far = Burgers(20.0, 6.0, 10.0, 0.5, 1.0, leading=leading)
    result = fit(record, far, noise="gaussian", seed=1)
    assert result.success
    for name in ("E1", "eta1", "E2", "eta2", "offset"):
        # Noiseless: limited by the solver's tolerance of 1e-10 on the objective, its root on values.
        value, true = (float(getattr(one, name)) for one in (result.model, truth))
        assert value == pytest.approx(true, rel=1e-4)
    assert isinstance(result.model, Burgers)
    assert result.model.leading is leading


@pytest.fixture(scope="module")
def sponge() -> Record:
    cycles = SpongeRig().five_cycles(noise=0.05, seed=0)
    return Record.from_arrays(
        cycles.force, cycles.displacement, cycles.time,
        input_unit="N", output_unit="mm", input_name="force (N)", output_name="displacement (mm)",
    )  # fmt: skip


@pytest.fixture(scope="module")
def sponge_fit(sponge: Record) -> FitResult:
    return fit(sponge, test_cycles=1, seed=0)


def test_auto_finds_the_hysteresis(sponge: Record, sponge_fit: FitResult) -> None:
    names = [c.name for c in sponge_fit.candidates]
    assert names[0] == "Preisach"  # a composition is no better beyond doubt, and less simple
    # No line can be as good, which is known before one is fitted.
    assert set(sponge_fit.skipped) & {"Burgers", "LinearSponge"} == {"LinearSponge"}
    assert {"Burgers", "curve"} < set(names)
    line = fit(sponge, "LinearSponge", test_cycles=1, noise="gaussian", starts=2)
    assert line.score > 1.1 * sponge_fit.score
    assert isinstance(sponge_fit.model, Preisach)
    assert not sponge_fit.model.leading
    assert sponge_fit.verdict.level == "PASS"
    assert sponge_fit.trusted
    test = sponge_fit.metrics["test"]
    # Reading noise of 0.05 mm on a range of 27 mm is 0.19 %.
    assert test.nrmse_percent < 0.5


def test_of_one_loop_the_simpler_kind_of_model_is_taken() -> None:
    """A geared drive turned to and fro six times: relays tell smaller turns, and the better of six held-out
    twentieths of a per cent tells nothing of them."""
    path = Path(both=True).cycles((1,) * 6).cycles((0.8, 0.6, 0.4, 0.2, 0.5, 0.9))
    u = np.concatenate(path.parts)
    found = fit(rigs.reading_of(rigs.RIGS["geared drive, angle"], u, 1), test_tail=0.5)
    by_name = {one.name: one for one in found.candidates}
    best = min(found.candidates, key=lambda one: one.score)
    assert found.name == "Preisach" != best.name
    assert by_name["Preisach"].score < 1.1 * best.score
    test, other = (one.metrics["test"] for one in (found, best))
    assert test.rmse < 0.75 * other.rmse


def test_test_rows_change_no_fit(sponge: Record) -> None:
    """Whatever stands in the held-out rows, the model is the same."""
    train, test = sponge.split_cycles(1)
    y = np.where(train.mask, train.output, 99.0)
    spoiled = Record.from_arrays(train.input, y, train.time, mask=train.mask)
    one, other = fit(train, "Preisach", test=test), fit(spoiled, "Preisach")
    np.testing.assert_array_equal(one.model.density.weights, other.model.density.weights)  # type: ignore[attr-defined]


def test_a_seed_makes_a_fit_repeatable() -> None:
    record, _ = creep_record(noise=0.02)
    one, other = (fit(record, "Burgers", seed=5, starts=8, noise="gaussian") for _ in range(2))
    assert [p.value for p in one.parameters] == [p.value for p in other.parameters]


def test_an_unidentified_parameter_has_no_error_bar() -> None:
    """A line through the origin is a spring: the delayed part and the flow cannot be told."""
    t = np.linspace(0.0, 10.0, 200)
    u = np.abs((t / 2.5 + 1) % 2 - 1)
    y = 0.5 * u + np.random.default_rng(0).normal(0, 0.005, 200)
    result = fit(Record.from_arrays(u, y, t), "Burgers", seed=0, noise="gaussian")
    flow = next(p for p in result.parameters if p.name == "eta1")
    assert flow.status == "unidentified"
    assert flow.stderr is None
    assert any("eta1" in reason for reason in result.verdict.reasons)


@pytest.mark.parametrize(("model", "options", "code"), [
    ("Presiach", {}, "unknown-model"),
    ("Burgers", {}, "no-time"),
    ("auto", {"test_cycles": 1, "test_tail": 0.1}, "conflicting-options"),
    ("Preisach", {"initial": "demagnetized"}, "bad-option"),
    ("Preisach", {"conditioning": "drop"}, "bad-option"),
    ("LinearSponge", {"starts": 0}, "bad-option"),
])  # fmt: skip
def test_faults_are_named(model: str, options: dict, code: str) -> None:
    u = np.abs((np.arange(200) / 25 + 1) % 2 - 1)
    refuses(code, lambda: fit(Record.from_arrays(u, u), model, **options))


def test_an_input_that_only_rises_is_left_to_the_models_without_memory() -> None:
    t = np.linspace(0.0, 1.0, 200)
    result = fit(Record.from_arrays(t, 2 * t + 0.01 * np.sin(40 * t)), "auto", noise="gaussian")
    assert "Preisach" in result.skipped
    assert result.name == "LinearSponge"


def test_an_interrupted_fit_gives_the_best_so_far(monkeypatch: pytest.MonkeyPatch) -> None:
    """And says what was not tried; before anything was fitted there is no result."""
    u = np.sin(np.linspace(0.0, 20.0, 200))
    record = Record.from_arrays(u, 2 * u + 0.01 * u**3)

    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("identify.fitting._linear.GridCandidate.fitted", interrupted)
    result = fit(record, "LinearSponge, Preisach, Composition", noise="gaussian")
    assert (result.name, set(result.skipped)) == ("LinearSponge", {"Preisach", "Composition"})
    with pytest.raises(KeyboardInterrupt):
        fit(record, "Preisach, LinearSponge")


def test_a_spent_budget_gives_the_best_so_far() -> None:
    """A first model is fitted whatever the budget, and the others are named."""
    u = np.sin(np.linspace(0.0, 20.0, 200))
    record = Record.from_arrays(u, 2 * u + 0.01 * u**3)
    result = fit(record, "LinearSponge, Preisach, Composition", budget=1e-6, noise="gaussian")
    assert (result.name, set(result.skipped)) == ("LinearSponge", {"Preisach", "Composition"})
    assert result.starts is not None
    assert len(result.starts.objective) == 1
    assert fit(record, "LinearSponge", budget=60.0, noise="gaussian").skipped == {}
    refuses("bad-option", lambda: fit(record, "LinearSponge", budget=0.0), "budget")


def test_a_saved_fit_comes_back(sponge_fit: FitResult, tmp_path) -> None:
    save(sponge_fit, tmp_path / "fit")
    again = load(tmp_path / "fit")
    np.testing.assert_array_equal(again.predict(again.train), sponge_fit.predict(sponge_fit.train))
    assert again.parameters == sponge_fit.parameters
    assert again.verdict == sponge_fit.verdict
    assert again.test_blocks.tolist() == sponge_fit.test_blocks.tolist()
    assert len(again.baselines) == 6
    assert to_json(again)["baselines"] == to_json(sponge_fit)["baselines"]
    assert again.train.digest() == sponge_fit.train.digest()
    refuses("would-overwrite", lambda: save(sponge_fit, tmp_path / "fit"), "left as they are")


def test_beyond_the_fitted_inputs_a_prediction_goes_on_and_is_marked(sponge_fit: FitResult) -> None:
    low, high = sponge_fit.train.input.min(), sponge_fit.train.input.max()
    beyond = np.linspace(high, high + 0.3 * (high - low), 30)[1:]
    u = np.concatenate([np.linspace(low, high, 50), beyond])
    further = Record.from_arrays(u, np.zeros(len(u)), np.linspace(0, 8, len(u)))
    y = sponge_fit.predict(further)
    assert np.all(np.diff(y[49:]) > 0)
    np.testing.assert_array_equal(sponge_fit.beyond(further), u > high)
