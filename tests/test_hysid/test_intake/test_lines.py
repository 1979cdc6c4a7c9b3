"""`--exclude-lines` and `--test-lines`: rows named by the lines of their file."""

from pathlib import Path

import numpy as np
import pytest

import hysid
from hysteresis import InputError

FILE = Path(__file__).parents[3] / "datasets" / "sponge-50mm-cycles.csv"
COLUMNS = {"input": "force (N)", "output": "displacement (mm)", "time": "time (s)"}


def records(**options):
    return hysid.records(FILE, **COLUMNS, **options)[""]


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
        ({"test_line": ("2-9",)}, "bad-option"),
        ({"test_cycles": "1"}, "bad-option"),
    ],
)
def test_lines_that_cannot_be_used(options, code):
    with pytest.raises(InputError) as caught:
        records(**options)
    assert caught.value.code == code
