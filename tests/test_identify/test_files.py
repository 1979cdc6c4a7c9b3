"""Fits on disk: what `load` gives back of the models that a fit tried, and of a fit of version 0.1.0."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import compensate
import hysid
import identify
from hysid import plots
from hysteresis import LinearSponge, Record
from identify import FitResult, fit, load, save
from identify.internal import sealed
from tests.refusals import refuses


@pytest.fixture(scope="module")
def both() -> FitResult:
    """A line and a stiffer line, fitted to the same loop, as the candidates of one fit."""
    u = np.concatenate([np.linspace(2, 20, 40), np.linspace(20, 2, 40)])
    y = 1.3 * u + 6 + 0.5 * np.sin(u)
    record = Record.from_arrays(u, y, np.arange(80.0), input_unit="N", output_unit="mm")
    line, fixed = (
        fit(
            record, LinearSponge(K=1.3, b=6.0, threshold=1.5), starts=1, noise="gaussian", **options
        )
        for options in ({}, {"parameters": {"K": {"fixed": 1.2}}})
    )
    return replace(line, candidates=(line, replace(fixed, name="LinearSponge of 1.2 mm/N")))


def test_the_figure_of_candidates_has_content_after_load(both: FitResult, tmp_path) -> None:
    axes = plots.candidates(load(save(both, tmp_path / "fit"))).axes[0]
    names = [label.get_text() for label in axes.get_yticklabels()]
    assert names == [candidate.name for candidate in both.candidates]
    assert [bar.get_width() for bar in axes.patches] == [c.score for c in both.candidates]


@pytest.mark.parametrize(("change", "words"), [
    (lambda d: d["verdict"].update(level="GOOD"), "verdict.level is 'GOOD'"),
    (lambda d: d["parameters"][0].update(value="much"), "parameters.0.value is 'much'"),
    (lambda d: d["candidates"][0]["metrics"]["train"].update(rmse=[]), "train"),
    (lambda d: d["noise"].update(samples=10**400), "noise.samples is 1000"),
    (lambda d: d["noise"].pop("sigma"), "sigma"),
    (lambda d: d.pop("seconds"), "seconds is missing"),
    (lambda d: d.update(blocks={}), "blocks"),
    (lambda d: d["records"]["train"].update(labels="all"), "records.train.labels is 'all'"),
])  # fmt: skip
def test_an_entry_of_another_type_is_named(both: FitResult, tmp_path, change, words: str) -> None:
    file = save(both, tmp_path / "fit") / "fit.json"
    document = json.loads(file.read_text())
    change(document)
    file.write_text(json.dumps(sealed(document)))
    refuses("damaged-file", lambda: load(file.parent), words)


FOLDER = Path(__file__).parent / "fit_of_0_1_0"


def test_it_loads_and_is_the_same(tmp_path: Path):
    fit = identify.load(FOLDER)
    assert (fit.name, fit.verdict.level, len(fit.baselines)) == ("Burgers", "PASS", 6)
    again = (fit.predict(fit.train) - fit.train.output)[fit.used]
    np.testing.assert_allclose(again, fit.residuals[fit.used], rtol=0, atol=1e-12)
    found = compensate.estimate(hysid.invert(fit), fit.train)
    assert np.isfinite(found.value).all()
    identify.save(fit, tmp_path / "again")
    assert identify.load(tmp_path / "again").metrics == fit.metrics
    assert hysid.report(fit, tmp_path / "fit.html").exists()
