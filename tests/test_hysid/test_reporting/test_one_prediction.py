"""One prediction: every number and picture of a report is that of `FitResult.predict` and of fit.json."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import identify
from hysid.figures import _base
from hysid.figures._format import quantity
from hysid.figures._plot import draw_fit
from hysid.reporting import _fit_page, _section_fit, _section_model
from hysid.reporting._case import Case
from hysteresis import Preisach, Record, extended
from hysteresis.preisach import GridDensity
from identify import FitResult, load, predict, predictive, sample
from identify.records._clocks import Clocks
from tests.test_hysid.command import run

FORCE, PATH, TIME = "force (N)", "path (mm)", "time (s)"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A Preisach fit to loops, and a held-out loop half as large again, where the model alone saturates."""
    place = tmp_path_factory.mktemp("loops")
    time = np.arange(0, 5, 0.02)
    force = np.where(time < 4, 10.0, 15.0) * (1 - np.cos(2 * np.pi * time)) / 2
    relays = np.tril(np.random.default_rng(0).uniform(0, 1, (8, 8)))
    truth = Preisach(GridDensity(0.0, 15.0, relays / 20), reversible=np.full(8, 0.5))
    path = predict(truth, Record.from_arrays(force, force, time))
    table = np.column_stack([time, force, path]).tolist()
    rows = [",".join(f"{x:.6f}" for x in row) for row in table]
    (place / "run.csv").write_text("\n".join([f"{TIME},{FORCE},{PATH}", *rows]))
    columns = ("--input", FORCE, "--output", PATH, "--time", TIME)
    said = run("fit", place / "run.csv", *columns, "--model", "Preisach", "--test-cycles", 1,
               "--clocks", "keep", "--out", place / "fit")  # fmt: skip
    assert said.code == 0, said.err
    return place


@pytest.fixture(scope="module")
def fit(folder: Path) -> FitResult:
    return load(folder / "fit")


@pytest.fixture(scope="module")
def document(folder: Path) -> dict[str, Any]:
    return json.loads((folder / "fit" / "fit.json").read_text())


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> dict[str, np.ndarray]:
    """The finite y of every curve that a section draws, by its label."""
    seen: dict[str, np.ndarray] = {}
    chart = _base.chart

    def noted(curves: Any, *arguments: Any, **named: Any) -> Any:
        for curve in curves:
            seen.setdefault(curve.label, curve.y[np.isfinite(curve.y)])
        return chart(curves, *arguments, **named)

    monkeypatch.setattr(_base, "chart", noted)
    return seen


def test_the_model_alone_would_draw_another_prediction(fit: FitResult):
    assert fit.test is not None
    counted = fit.test.mask
    alone = (predict(fit.model, fit.test) - fit.test.output)[counted]
    ours = (fit.predict(fit.test) - fit.test.output)[counted]
    assert np.sqrt(np.mean(alone**2)) > 3 * np.sqrt(np.mean(ours**2))


def test_figures_of_a_fit_are_of_its_prediction(fit: FitResult, document: dict[str, Any]):
    for part, record, rows in (
        ("train", fit.train, fit.used),
        ("test", fit.test, fit.test.mask if fit.test is not None else None),
    ):
        assert record is not None
        assert rows is not None
        error = (fit.predict(record) - record.output)[rows]
        found = document["metrics"][part]
        assert found["rmse"] == pytest.approx(np.sqrt(np.mean(error**2)), rel=1e-9)
        assert found["max_abs"] == pytest.approx(np.abs(error).max(), rel=1e-9)
        assert found["nrmse_percent"] == pytest.approx(
            100 * found["rmse"] / np.ptp(record.output[rows]), rel=1e-9
        )
    residuals = (fit.predict(fit.train) - fit.train.output)[fit.used]
    assert residuals == pytest.approx(fit.residuals[fit.used], abs=1e-12)


def test_every_number_and_picture_of_a_report_is_in_fit_json(
    folder: Path, fit: FitResult, document: dict[str, Any], drawn: dict[str, np.ndarray]
):
    case = Case(folder / "fit", document, fit, None)
    train, test = document["metrics"]["train"], document["metrics"]["test"]
    loops = _section_fit.loops(case)
    assert fit.test is not None
    ours = {"train": fit.predict(fit.train), "test": fit.predict(fit.test)}
    measured = {"train": fit.train.output[fit.used], "test": fit.test.output[fit.test.mask]}
    assert np.array_equal(drawn["measured, training"], measured["train"])
    assert np.array_equal(drawn["measured, held-out"], measured["test"])
    assert np.array_equal(drawn["Preisach model"], ours["train"][fit.used])  # drawn first
    assert [f"rms error {quantity(m['rmse'], 'mm')}." in p.caption
            for m, p in zip((train, test), loops.pictures, strict=True)] == [True, True]  # fmt: skip
    residuals = _section_fit.residuals(case)
    assert quantity(train["rmse"], "mm") in residuals.text[0]
    assert drawn["training"] == pytest.approx(ours["train"][fit.used] - measured["train"])
    assert drawn["held-out"] == pytest.approx(ours["test"][fit.test.mask] - measured["test"])
    facts = dict(_fit_page.facts(case))
    compensator = _section_model.compensator(case)
    assert facts["held-out error, rms"] == quantity(test["rmse"], "mm")
    assert facts["held-out error, largest"] == quantity(test["max_abs"], "mm")
    assert facts["held-out error, of the range"] == quantity(test["nrmse_percent"], "%")
    assert facts["fitted rows, of the range"] == quantity(train["nrmse_percent"], "%")
    beyond = document["extrapolation"]["input"]
    assert beyond["rows"] > 0
    said = f"{beyond['rows']} held-out rows lie beyond the trained inputs; the error there is"
    assert f"{said} {quantity(beyond['rmse'], 'mm')} rms." in loops.notes
    (table,) = _section_fit.candidates(case).tables
    listed = {row[0]: row[1:] for row in table.rows}
    for one in document["baselines"]:
        assert listed[one["name"]][2:4] == (
            quantity(one["nrmse_percent"], "%"),
            quantity(one["rmse"], "mm"),
        )
    assert table.rows[0][2:5] == (
        quantity(train["nrmse_percent"], "%"),
        quantity(test["nrmse_percent"], "%"),
        quantity(test["rmse"], "mm"),
    )
    said = run("qualify", folder / "fit", folder / "run.csv", "--json")
    qualified = json.loads(said.out)
    assert (said.code, qualified["verdict"]["level"]) == (
        2,
        "FAIL",
    )  # it stops at the trained forces
    off = quantity(qualified["errors"]["rmse"], "N")
    assert facts["compensator on held-out rows, rms"] == off
    assert f"an error of {off} rms" in compensator.text[0]


def test_predict_says_the_same_of_the_same_rows(folder: Path, fit: FitResult):
    found = run("predict", folder / "fit", folder / "run.csv", "--json").json()
    lines = Path(found["file"]).read_text().splitlines()[1:]
    predicted = np.array([float(line.split(",")[3]) for line in lines])
    assert fit.test is not None
    assert predicted == pytest.approx(fit.predict(fit.test), abs=1e-9)


def test_other_views_have_the_same_prediction(fit: FitResult):
    assert fit.test is not None
    error = fit.predict(fit.test) - fit.test.output
    parts = identify.breakdown(fit, fit.test).of("branch")
    squares = sum(part.rows * part.rmse**2 for part in parts)
    assert squares == pytest.approx(np.sum(error[fit.test.mask] ** 2), rel=1e-9)
    (figure,) = [draw_fit(fit)]
    line = next(x for x in figure.axes[0].lines if x.get_label() == "Preisach")
    shown = np.asarray(line.get_ydata(), float)
    assert shown[np.isfinite(shown)] == pytest.approx(fit.predict(fit.test)[fit.test.mask])
    bands = predictive(fit, posterior=sample(fit, steps=20, ensembles=2))
    alone = predict(fit.model, fit.test)[bands.rows]
    ours = fit.predict(fit.test)[bands.rows]
    assert np.abs(bands.middle - ours).max() < 0.2 * np.abs(alone - ours).max()


def test_a_lag_is_taken_out_once(fit: FitResult):
    """Whether a record is as it was measured or as the model sees it, a prediction of it is the same."""
    lagging = replace(fit, clocks=Clocks(lag=0.05))
    seen = lagging.clocks.applied(fit.train)
    assert not np.array_equal(seen.input, fit.train.input)
    assert np.array_equal(lagging.predict(fit.train), lagging.predict(seen))
    low, high = seen.input.min(), seen.input.max()
    assert np.array_equal(lagging.predict(seen), predict(extended(fit.model, low, high), seen))
