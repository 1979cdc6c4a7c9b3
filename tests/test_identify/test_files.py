"""Fits on disk: what `load` gives back of the models that a fit tried."""

import json
from dataclasses import asdict, replace

import numpy as np
import pytest

from hysid import plots
from hysteresis import InputError, LinearSponge, Record
from identify import Candidate, FitResult, compare_candidates, fit, load, save
from identify.internal import residuals_of_all, sealed, to_json


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


def test_candidates_come_back_with_their_figures(both: FitResult, tmp_path) -> None:
    again = load(save(both, tmp_path / "fit"))
    assert all(isinstance(candidate, Candidate) for candidate in again.candidates)
    for tried, read in zip(both.candidates, again.candidates, strict=True):
        own = asdict(read)
        assert own.pop("seconds") == pytest.approx(tried.seconds, abs=1e-3)  # ms in the file
        np.testing.assert_array_equal(own.pop("blocks"), tried.blocks)
        np.testing.assert_equal(own.pop("score"), tried.score)
        for name in ("noise", "noise_model", "metrics", "parameters"):
            assert (
                repr(getattr(read, name)) == repr(getattr(again, name)) or read.name != again.name
            )
        for name in (
            "name",
            "success",
            "trusted",
            "parameter_count",
            "notes",
            "verdict",
            "metrics",
        ):
            assert getattr(read, name) == getattr(tried, name)


def test_residuals_of_candidates_and_baselines_are_saved_by_the_fit_that_tried_them(
    both: FitResult, tmp_path
):
    first = save(both, tmp_path / "one")
    tried = np.array([candidate.residuals for candidate in both.candidates])
    simple = np.array([baseline.residuals for baseline in both.baselines])
    for saved, found in zip(residuals_of_all(first), (tried, simple), strict=True):
        np.testing.assert_allclose(saved, found, rtol=1e-6)
    assert residuals_of_all(save(load(first), tmp_path / "two")) == (None, None)
    for one in both.baselines:  # the residuals are those of its figures
        rmse = np.sqrt(np.nanmean(one.residuals**2))
        assert rmse == pytest.approx(one.metrics["train"].rmse)


def test_a_loaded_fit_says_and_compares_what_the_fit_does(both: FitResult, tmp_path) -> None:
    first = save(both, tmp_path / "one")
    again = load(first)
    assert to_json(again)["candidates"] == to_json(both)["candidates"]
    second = save(again, tmp_path / "two")
    assert compare_candidates(first).words == compare_candidates(second).words


def test_the_figure_of_candidates_has_content_after_load(both: FitResult, tmp_path) -> None:
    axes = plots.candidates(load(save(both, tmp_path / "fit"))).axes[0]
    assert [label.get_text() for label in axes.get_yticklabels()] == [
        candidate.name for candidate in both.candidates
    ]
    assert [bar.get_width() for bar in axes.patches] == [c.score for c in both.candidates]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda d: d["verdict"].update(level="GOOD"), "verdict.level is 'GOOD'"),
        (lambda d: d["parameters"][0].update(value="much"), "parameters.0.value is 'much'"),
        (lambda d: d["candidates"][0]["metrics"]["train"].update(rmse=[]), "train"),
        (lambda d: d["noise"].update(samples=10**400), "noise.samples is 1000"),
        (lambda d: d["noise"].pop("sigma"), "sigma"),
        (lambda d: d.pop("seconds"), "seconds is missing"),
        (lambda d: d.update(blocks={}), "blocks"),
        (lambda d: d["records"]["train"].update(labels="all"), "records.train.labels is 'all'"),
    ],
)  # fmt: skip
def test_an_entry_of_another_type_is_named(both: FitResult, tmp_path, change, words: str) -> None:
    file = save(both, tmp_path / "fit") / "fit.json"
    document = json.loads(file.read_text())
    change(document)
    file.write_text(json.dumps(sealed(document)))
    with pytest.raises(InputError) as caught:
        load(file.parent)
    assert caught.value.code == "damaged-file"
    assert words in str(caught.value)
