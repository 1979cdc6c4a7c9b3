"""One prediction: every number and picture of a report is that of `FitResult.predict` and of fit.json."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import identify
from hysteresis import Preisach, Record
from hysteresis.preisach import GridDensity
from identify import FitResult, load, predictive, sample
from identify.internal import predict
from tests.test_hysid.command import put, run, text
from tests.test_hysid.test_reporting.test_report import Page

FORCE, PATH, TIME = "force (N)", "path (mm)", "time (s)"


def quantity(x: float, unit: str) -> str:
    mantissa, power = f"{x:.2e}".split("e")
    raised = str(int(power)).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
    shown = f"{x:#.3g}".rstrip(".") if x >= 1e-4 else f"{mantissa} × 10{raised}"
    return f"{shown} {unit}"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A Preisach fit to loops, and a held-out loop half as large again, where the model alone saturates."""
    place, time = tmp_path_factory.mktemp("loops"), np.arange(0, 5, 0.02)
    force = np.where(time < 4, 10.0, 15.0) * (1 - np.cos(2 * np.pi * time)) / 2
    relays = np.tril(np.random.default_rng(0).uniform(0, 1, (8, 8)))
    truth = Preisach(GridDensity(0.0, 15.0, relays / 20), reversible=np.full(8, 0.5))
    path = predict(truth, Record.from_arrays(force, force, time))
    rows = np.column_stack([time, force, path]).round(6)
    put(text(rows, (TIME, FORCE, PATH)), place / "run.csv")
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


def test_the_model_alone_would_draw_another_prediction(fit: FitResult):
    counted = fit.test.mask
    alone = (predict(fit.model, fit.test) - fit.test.output)[counted]
    ours = (fit.predict(fit.test) - fit.test.output)[counted]
    assert np.sqrt(np.mean(alone**2)) > 3 * np.sqrt(np.mean(ours**2))


def test_figures_of_a_fit_are_of_its_prediction(fit: FitResult, document: dict[str, Any]):
    for part, record, rows in (("train", fit.train, fit.used), ("test", fit.test, fit.test.mask)):
        error = (fit.predict(record) - record.output)[rows]
        found = document["metrics"][part]
        assert found["rmse"] == pytest.approx(np.sqrt(np.mean(error**2)), rel=1e-9)
        assert found["max_abs"] == pytest.approx(np.abs(error).max(), rel=1e-9)
        percent = 100 * found["rmse"] / np.ptp(record.output[rows])
        assert found["nrmse_percent"] == pytest.approx(percent, rel=1e-9)
    residuals = (fit.predict(fit.train) - fit.train.output)[fit.used]
    assert residuals == pytest.approx(fit.residuals[fit.used], abs=1e-12)


def test_every_number_of_a_report_is_in_fit_json(folder: Path, document: dict[str, Any]):
    said = run("qualify", folder / "fit", folder / "run.csv", "--json")
    qualified = json.loads(said.out)
    # It stops at the trained forces.
    assert (said.code, qualified["verdict"]["level"]) == (2, "FAIL")
    page = Page(Path(run("report", folder / "fit", "--json").json()["file"])).text
    train, test = document["metrics"]["train"], document["metrics"]["test"]
    beyond, off = document["extrapolation"]["input"], quantity(qualified["errors"]["rmse"], "N")
    held = document["compensator"]["band"]["coverage"]
    assert beyond["rows"] > 0
    for words in (
        f"rms error {quantity(train['rmse'], 'mm')}.",
        f"rms error {quantity(test['rmse'], 'mm')}.",
        f"held-out error, rms {quantity(test['rmse'], 'mm')}",
        f"held-out error, largest {quantity(test['max_abs'], 'mm')}",
        f"held-out error, of the range {quantity(test['nrmse_percent'], '%')}",
        f"fitted rows, of the range {quantity(train['nrmse_percent'], '%')}",
        f"an input beyond the trained ones {beyond['rows']} held-out rows {quantity(beyond['rmse'], 'mm')}",
        f"compensator on held-out rows, rms {off}",
        f"an error of {off} rms",
        f"deviations hold {100 * held:#.3g} %",
        *(
            f"{quantity(one['nrmse_percent'], '%')} {quantity(one['rmse'], 'mm')}"
            for one in document["baselines"]
        ),
    ):
        assert words in page, words


def test_predict_says_the_same_of_the_same_rows(folder: Path, fit: FitResult):
    found = run("predict", folder / "fit", folder / "run.csv", "--json").json()
    lines = Path(found["file"]).read_text().splitlines()[1:]
    predicted = np.array([float(line.split(",")[3]) for line in lines])
    assert predicted == pytest.approx(fit.predict(fit.test), abs=1e-9)


def test_other_views_have_the_same_prediction(fit: FitResult):
    error = fit.predict(fit.test) - fit.test.output
    parts = identify.breakdown(fit, fit.test).of("branch")
    squares = sum(part.rows * part.rmse**2 for part in parts)
    assert squares == pytest.approx(np.sum(error[fit.test.mask] ** 2), rel=1e-9)
    figure = fit.plot()
    line = next(x for x in figure.axes[0].lines if x.get_label() == "Preisach")
    shown = np.asarray(line.get_ydata(), float)
    assert shown[np.isfinite(shown)] == pytest.approx(fit.predict(fit.test)[fit.test.mask])
    bands = predictive(fit, posterior=sample(fit, steps=20, ensembles=2))
    alone = predict(fit.model, fit.test)[bands.rows]
    ours = fit.predict(fit.test)[bands.rows]
    assert np.abs(bands.middle - ours).max() < 0.2 * np.abs(alone - ours).max()
