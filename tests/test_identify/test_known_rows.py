"""Records whose first rows are known: fits behind their pasts, predictions from there, relative errors."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import identify
from hysid import Record
from hysteresis import PrandtlIshlinskii, StandardLinearSolid
from hysteresis.internal import with_units
from tests.refusals import raises, refuses

KNOWN, LENGTH, SEQUENCES = 20, 60, 5
CREEP = with_units(StandardLinearSolid(2.0, 1.0, 30.0), None, (0.0, 3.0))


def walk(random: np.random.Generator, rows: int, leg: int) -> np.ndarray:
    """An input that turns after every so many rows."""
    turns = random.uniform(0, 3, rows // leg + 2)
    return np.interp(np.arange(rows) / leg, np.arange(len(turns)), turns)


def cut_from_one_history(seed: int = 0) -> Record:
    """Sequences that begin where the one before ended, with names and clocks of their own."""
    random, rows = np.random.default_rng(seed), SEQUENCES * LENGTH
    u, t = walk(random, rows, 12), 0.5 * np.arange(rows)
    y = np.asarray(CREEP.simulate(t, u))
    y = y + 0.005 * np.std(y) * random.normal(size=rows)
    return Record.from_arrays(
        u, y, t, np.arange(rows) // LENGTH, input_unit="N", output_unit="mm", input_name="force",
        output_name="way", line=np.arange(2, rows + 2),
    )  # fmt: skip


@pytest.fixture(scope="module")
def fit() -> identify.FitResult:
    train, test = cut_from_one_history().split_groups(["4"])
    how = {"known": KNOWN, "starts": 4, "noise": "gaussian"}
    return identify.fit(train, "StandardLinearSolid", test=test, **how)


def test_a_fit_behind_the_pasts_finds_the_model(fit: identify.FitResult):
    assert fit["E1"].value == pytest.approx(2.0, rel=0.05)
    assert fit.metrics["test"].nrmse_percent < 4
    assert not fit.train.mask[fit.train.line == 0].any()


def test_known_rows_tell_where_a_sequence_begins(fit: identify.FitResult):
    record = cut_from_one_history(1).take_sequences(["3"])
    told, alone = (
        np.std((fit.predict(record, known=known) - record.output)[KNOWN:])
        for known in (KNOWN, None)
    )
    assert told < 0.1 * alone


def cut_from_loops(seed: int = 0, sequences: int = 20) -> Record:
    """Friction with eddies, whose sequences begin in the middle of a history that nobody has seen."""
    random, rows = np.random.default_rng(seed), sequences * LENGTH
    u = walk(random, rows, 8)
    law = PrandtlIshlinskii([0.2, 0.5, 1.2], [1.0, 1.0, 1.0], 0.5)
    y = np.asarray(law.simulate(None, u)) + 2 * np.gradient(u)
    return Record.from_arrays(
        u, y + 0.01 * random.normal(size=rows), np.arange(rows), np.arange(rows) // LENGTH,
        line=np.arange(2, rows + 2),
    )  # fmt: skip


def test_terms_of_each_sequence_are_taken_where_states_tell_less(tmp_path: Path):
    record = cut_from_loops()
    fit = identify.fit(record, "PrandtlIshlinskii", known=KNOWN, starts=2, noise="gaussian")
    identify.save(fit, tmp_path / "fit")
    other = cut_from_loops(1, 5)
    found = identify.load(tmp_path / "fit").predict(other, known=KNOWN)
    assert found == pytest.approx(fit.predict(other, known=KNOWN))
    unknown = np.arange(len(other)) % LENGTH >= KNOWN
    off, alone = ((one - other.output)[unknown] for one in (found, fit.predict(other)))
    assert np.std(off) < 0.7 * np.std(alone)  # 0.59
    known = replace(other, columns={**other.columns, "known_rows": ~unknown})
    z = off / fit.sequences.predicted(known)[1][unknown]
    assert 0.4 < np.sqrt(np.mean(z**2)) < 2.5


def test_what_is_no_number_of_rows_is_told(fit: identify.FitResult):
    record = cut_from_one_history()
    rows = len(record)
    words = {"word": np.full(rows, "many"), "half": np.full(rows, 2.5)}
    record = replace(record, columns={**record.columns, **words})
    for known in ("many", *words):
        with raises("bad-option", "neither a number of rows nor a column"):
            fit.predict(record, known=known)
    refuses("no-rows", lambda: fit.predict(record, known=LENGTH), "none is left")
    np.testing.assert_array_equal(fit.predict(record, known=0), fit.predict(record))


def test_errors_count_by_sequence():
    """The line is that of relative errors, and what is said of held-out sequences is their mean."""
    u = np.tile(1 + np.sin(np.arange(60) / 5), 2)
    run = np.repeat([0, 1], 60)
    y = np.where(run, 20.0, 1.0) * u
    record = Record.from_arrays(u, y, groups=run)
    options = {"noise": "gaussian", "conditioning": "keep", "parameters": {"b": {"fixed": 0.0}}}
    fit = identify.fit(record, "LinearSponge", test=record, score="sre", starts=1, **options)
    weight = 1 / np.array([np.mean(y[run == k] ** 2) for k in run])
    slope = (weight * u * y).sum() / (weight * u * u).sum()
    assert fit["K"].value == pytest.approx(slope, rel=1e-3)
    off = (fit["K"].value * u - y) ** 2 * weight
    said = 100 * np.mean([np.sqrt(off[run == k].mean()) for k in (0, 1)])
    assert any(f"{said:.3g} % of the rms of each one's output" in note for note in fit.notes)
    assert "sigma" not in fit.verdict.codes  # nobody gave one
