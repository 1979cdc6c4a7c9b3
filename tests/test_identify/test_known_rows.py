"""Records whose first rows are known: fits behind their pasts, predictions from there, relative errors."""

import numpy as np
import pytest

import identify
from hysid import Record
from hysteresis import InputError, StandardLinearSolid, with_units
from hysteresis.records._csv import with_known
from identify.records._from_known import Misfit, by_sequence, from_known, sequence_error, with_past

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
    later = with_known(record, KNOWN)
    error = sequence_error(later, fit.predict(record, known=KNOWN))
    assert error < 0.1 * sequence_error(later, fit.predict(record))


def test_errors_count_by_sequence():
    record = Record.from_arrays(
        [0.0, 1, 2, 0, 1, 2], [1.0, 1, 1, 10, 10, 10], groups=[0, 0, 0, 1, 1, 1]
    )
    assert by_sequence(record).weights[0] == pytest.approx(10 * by_sequence(record).weights[-1])
    assert sequence_error(record, record.output * 1.1) == pytest.approx(10)
    assert sequence_error(record, record.output + 0.1) == pytest.approx((10 + 1) / 2)


def test_an_error_at_the_last_known_row_fades_out():
    record = with_known(cut_from_one_history().take_sequences(["0"]), KNOWN)
    shifted = record.noted("shifted", "shifted", output=record.output + 1.0)
    plain = from_known(CREEP, shifted, Misfit(100.0)).values
    carried = np.abs(from_known(CREEP, shifted, Misfit(100.0, lasts=10.0)).values - plain)
    assert (carried[:KNOWN] == 0).all()
    assert carried[KNOWN] > 2 * carried[KNOWN + 10] > 0


def test_the_rows_before_drive_a_model_and_do_not_count():
    record = with_known(cut_from_one_history(), KNOWN)
    longer = with_past(CREEP, record)
    before = longer.line == 0
    assert len(longer) > len(record)
    assert longer.known is None
    assert np.isnan(longer.output[before]).all()
    assert not longer.mask[before].any()
    assert longer.mask.sum() == record.mask.sum()
    errors = np.asarray(
        CREEP.simulate(longer.time, longer.input, starts=tuple(longer.starts.tolist()))
    )
    off = (errors - longer.output)[longer.mask]
    assert np.sqrt(np.mean(off**2)) < 0.02 * np.std(record.output)


def test_what_is_no_number_of_rows_is_told():
    record = cut_from_one_history()
    with pytest.raises(InputError, match="neither a number of rows nor a column") as found:
        with_known(record, "many")
    assert found.value.code == "bad-option"
    with pytest.raises(InputError, match="none is left") as found:
        with_known(record, LENGTH)
    assert found.value.code == "no-rows"
