"""Conditions of a record: columns beside the input on which the output depends too."""

from pathlib import Path

import numpy as np
import pytest

from hysteresis import Record, read_csv
from tests.refusals import refuses

U, Y, C, T = "force (N)", "strain (percent)", "temperature (K)", "time (s)"


def table(rows: int = 30, levels: tuple[float, ...] = (280.0, 300.0, 320.0)) -> dict:
    """Runs one after the other, each at one temperature but for its noise."""
    t = np.tile(np.arange(float(rows)), len(levels))
    u = np.abs((t % 10) - 5)
    c = np.repeat(levels, rows) + 0.01 * np.sin(t)
    return {T: t, U: u, Y: u * c / 300, C: c, "run": np.repeat(np.arange(len(levels)), rows)}


def of(columns: dict, **options) -> Record:
    return Record.from_columns(columns, **({"output": Y, "time": T, "group": "run"} | options))


def written(path: Path, columns: dict) -> Path:
    rows = zip(*(np.asarray(x).tolist() for x in columns.values()), strict=True)
    lines = [",".join(columns), *(",".join(map(str, row)) for row in rows)]
    path.write_text("\n".join(lines))
    return path


def test_a_record_keeps_a_condition_with_its_unit_through_selection_and_resampling():
    record = of(table(), input=U, condition=C)
    assert record.conditions == {C: "K"}
    assert (record.input_name, record.channels) == (U, {})
    assert abs(record.take_sequences(["1"]).columns[C] - 300).max() < 0.02
    fine = record.resample(0.5)
    assert fine.columns[C][1] == pytest.approx(record.columns[C][:2].mean())
    assert record.summary()["conditions"][0]["min"] == record.columns[C].min()
    assert "condition temperature (K): 280 to 320 K" in record.describe()


def test_the_digest_tells_conditions_apart():
    columns = table()
    warmer = columns | {C: columns[C] + 1}
    digests = {of(one, input=U, condition=C).digest() for one in (columns, warmer)}
    assert len(digests) == 2
    assert of(columns, input=U).digest() == of(warmer, input=U).digest()


def test_an_input_that_stays_in_every_run_and_differs_between_them_is_a_condition():
    record = of(table(), input=[U, C])
    assert (record.input_name, record.input_unit) == (U, "N")
    assert (record.channels, record.conditions) == ({}, {C: "K"})
    np.testing.assert_array_equal(record.input, table()[U])
    assert "condition" in {note.code for note in record.history}


def test_an_input_that_moves_within_a_run_or_never_at_all_is_a_channel():
    moving = table() | {C: 300 + np.sin(np.arange(90.0))}
    still = table(levels=(300.0, 300.0)) | {C: np.full(60, 300.0)}
    for columns in (moving, still):
        record = of(columns, input=[U, C])
        assert set(record.channels) == {U, C}
        assert record.conditions == {}


def test_two_clean_channels_of_one_run_stay_channels():
    columns = table(levels=(300.0,)) | {"second (V)": np.linspace(0, 1, 30)}
    assert len(of(columns, input=[U, "second (V)"], group=None).channels) == 2


def test_a_condition_must_be_complete():
    columns = table()
    columns[C][4] = np.nan
    refuses("nan-condition", lambda: of(columns, input=U, condition=C))
    filled = of(columns, input=U, condition=C, nan="interpolate")
    assert np.isfinite(filled.columns[C]).all()


def test_a_file_gives_the_same_record(tmp_path):
    file = written(tmp_path / "runs.csv", table())
    by_name = read_csv(file, U, Y, T, group="run", condition=(C,))
    by_itself = read_csv(file, [U, C], Y, T, group="run")
    for record in (by_name, by_itself):
        assert record.conditions == {C: "K"}
        assert record.digest() == of(table(), input=U, condition=C).digest()
    refuses("no-column", lambda: read_csv(file, U, Y, T, group="run", condition=("humidity",)))
