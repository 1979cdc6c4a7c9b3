"""`--exclude-lines` and `--test-lines`: rows named by the lines of their file."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hysid.intake._columns import for_new_file
from hysid.intake._selection import Selection, as_ranges, on_lines
from hysteresis import InputError

FILE = Path(__file__).parents[3] / "datasets" / "sponge-50mm-cycles.csv"
COLUMNS = {"input": "force (N)", "output": "displacement (mm)", "time": "time (s)"}


def records(**options):
    selection = Selection(**COLUMNS, **options)
    return selection.records(selection.read(FILE))[0][""]


@given(st.lists(st.booleans(), min_size=1, max_size=40), st.integers(1, 3))
def test_ranges_of_chosen_rows_hold_these_rows_and_no_others(chosen, apart):
    line = 2 + apart * np.arange(len(chosen))
    assert on_lines(line, as_ranges(line, np.array(chosen))).tolist() == chosen


def test_excluded_rows_drive_the_model_and_do_not_count():
    whole, _ = records()
    train, test = records(exclude_lines=("2-11", "50"))
    assert test is None
    np.testing.assert_array_equal(train.input, whole.input)
    assert set(whole.line[~train.mask]) == {*range(2, 12), 50}
    assert train.history[-1].code == "excluded"


def test_held_out_lines_are_tested_and_excluded_ones_are_not():
    train, test = records(test_lines=("60-100",), exclude_lines=("90-95",))
    assert set(test.line[test.mask]) == {*range(60, 90), *range(96, 101)}
    assert not (train.mask & (test.mask | ((train.line >= 60) & (train.line <= 100)))).any()


@pytest.mark.parametrize(
    ("options", "code"),
    [
        ({"exclude_lines": ("9-2",)}, "bad-option"),
        ({"exclude_lines": ("two",)}, "bad-option"),
        ({"test_lines": ("5000-6000",)}, "no-match"),
        ({"exclude_lines": ("2-5000",)}, "no-rows"),
        ({"test_lines": ("2-9",), "test_cycles": 1}, "conflicting-options"),
    ],
)
def test_lines_that_cannot_be_used(options, code):
    with pytest.raises(InputError) as caught:
        records(**options)
    assert caught.value.code == code


def test_lines_of_the_fitted_file_say_nothing_of_another():
    selection = Selection(**COLUMNS, exclude_lines=("2-11",), rezero=("20:0.1",))
    other = for_new_file(selection, selection.read(FILE), inverse=False)[0]
    assert (other.exclude_lines, other.rezero) == ((), ())
