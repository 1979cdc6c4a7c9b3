"""Records whose first rows are known: fits behind their pasts, predictions from there, relative errors."""

import numpy as np
import pytest

import identify
from hysid import Record
from hysteresis import InputError, StandardLinearSolid, with_units
from identify.records._from_known import by_sequence, sequence_error

KNOWN, LENGTH, SEQUENCES = 20, 60, 5
CREEP = with_units(StandardLinearSolid(2.0, 1.0, 30.0), None, (0.0, 3.0))


def cut_from_one_history(seed: int = 0) -> Record:
    """Sequences that begin where the one before ended, with names and clocks of their own."""
    random = np.random.default_rng(seed)
    rows = SEQUENCES * LENGTH
    turns = random.uniform(0, 3, rows // 12 + 2)
    u = np.interp(np.arange(rows) / 12, np.arange(len(turns)), turns)
    t = 0.5 * np.arange(rows)
    y = np.asarray(CREEP.simulate(t, u))
    y = y + 0.005 * np.std(y) * random.normal(size=rows)
    return Record.from_arrays(
        u, y, t, np.arange(rows) // LENGTH, input_unit="N", output_unit="mm", input_name="force",
        output_name="way", line=np.arange(2, rows + 2),
    )  # fmt: skip


@pytest.fixture(scope="module")
def fit() -> identify.FitResult:
    train, test = cut_from_one_history().split_groups(["4"])
    return identify.fit(
        train, "StandardLinearSolid", test=test, known=KNOWN, starts=4, noise="gaussian"
    )


def test_a_fit_behind_the_pasts_finds_the_model(fit: identify.FitResult):
    assert fit["E1"].value == pytest.approx(2.0, rel=0.05)
    assert fit.metrics["test"] is not None
    assert fit.metrics["test"].nrmse_percent < 4
    assert not fit.train.mask[fit.train.line == 0].any()


def test_known_rows_tell_where_a_sequence_begins(fit: identify.FitResult):
    record = cut_from_one_history(1).take_sequences(["3"])
    told, alone = (
        np.std((fit.predict(record, known=known) - record.output)[KNOWN:])
        for known in (KNOWN, None)
    )
    assert told < 0.1 * alone


def test_what_is_no_number_of_rows_is_told(fit: identify.FitResult):
    record = cut_from_one_history()
    with pytest.raises(InputError, match="neither a number of rows nor a column") as found:
        fit.predict(record, known="many")
    assert found.value.code == "bad-option"
    with pytest.raises(InputError, match="none is left") as found:
        fit.predict(record, known=LENGTH)
    assert found.value.code == "no-rows"


def test_errors_count_by_sequence():
    record = Record.from_arrays(
        [0.0, 1, 2, 0, 1, 2], [1.0, 1, 1, 10, 10, 10], groups=[0, 0, 0, 1, 1, 1]
    )
    assert by_sequence(record).weights[0] == pytest.approx(10 * by_sequence(record).weights[-1])
    assert sequence_error(record, record.output * 1.1) == pytest.approx(10)
    assert sequence_error(record, record.output + 0.1) == pytest.approx((10 + 1) / 2)
