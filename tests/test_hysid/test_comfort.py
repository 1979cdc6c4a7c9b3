"""The short ways in: arrays, data frames, models at `hysid`, one HTML file, double precision."""

import inspect
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hysid
import hysteresis
from hysteresis import AbstractModel, InputError, LinearSponge, Record, Series, Sum

U = np.concatenate([np.linspace(0, 20, 60), np.linspace(20, 0, 60)] * 3)
Y = 2.0 * U + 1 + 0.01 * np.sin(np.arange(len(U)) * 7.0)
UNITS: dict[str, Any] = {"input_unit": "N", "output_unit": "mm"}
HOW: dict[str, Any] = {"model": "LinearSponge", "noise": "gaussian", "starts": 2}


class Frame:
    """What pandas and polars have in common: names in `columns`, and a column by its name."""

    def __init__(self, columns: dict[str, Any]):
        self.data, self.columns = columns, list(columns)

    def __getitem__(self, name: str) -> Any:
        return self.data[name]


def test_fit_takes_arrays_frames_and_mappings():
    columns = {"force (N)": U.tolist(), "x_mm": Y}
    whole = hysid.fit(U, Y, **UNITS, **HOW)
    for data in (columns, Frame(columns)):
        found = hysid.fit(data, input="force (N)", output="x_mm", **HOW)
        assert found.parameters[0].value == whole.parameters[0].value
        assert (found.train.input_unit, found.train.output_unit) == ("N", "mm")
    record = Record.from_arrays(U, Y, **UNITS)
    again = hysid.fit(record, "LinearSponge", noise="gaussian", starts=2)
    assert again.parameters == whole.parameters


@pytest.mark.parametrize(
    ("call", "code"),
    [
        (lambda: hysid.fit(U), "bad-option"),
        (lambda: hysid.fit(Record.from_arrays(U, Y), input="u", output="y"), "bad-option"),
        (lambda: hysid.fit({"u": U, "y": Y}, input="v", output="y"), "no-column"),
    ],
)
def test_fit_says_how_to_call_it(call: Any, code: str):
    with pytest.raises(InputError) as caught:
        call()
    assert caught.value.code == code


def test_columns_become_channels_sequences_and_times():
    table = {"a (V)": U, "b (V)": U + 1, "x": Y, "t (ms)": np.arange(360.0), "run": U * 0 + 1}
    record = Record.from_columns(table, ["a (V)", "b (V)"], "x", "t (ms)", "run")
    assert record.channels == {"a (V)": "V", "b (V)": "V"}
    assert (record.time_unit, record.output_unit, record.labels) == ("ms", "1", ("1.0",))


def test_a_record_called_wrongly_says_what_to_call():
    record: Any = Record
    for arguments in ((), (U, Y), ("run.csv",)):
        with pytest.raises(InputError, match=r"Record.from_arrays"):
            record(*arguments)


def test_compositions_take_models_or_a_list():
    line = LinearSponge(K=2.0, b=1.0, threshold=0.0)
    u = np.array([1.0, 2.0])
    for kind in (Series, Sum):
        one, other = kind(line, line), kind([line, line])
        assert len(one.parts) == 2
        np.testing.assert_array_equal(one.simulate(None, u), other.simulate(None, u))
        assert len(kind(kind(line, line), line).parts) == 3
        assert kind(parts=(line,)).parts == kind(line).parts
        with pytest.raises(InputError, match="bad-parts"):
            kind()


def test_every_model_is_at_hysid():
    models = {
        name
        for name, value in vars(hysteresis).items()
        if inspect.isclass(value)
        and issubclass(value, AbstractModel)
        and not inspect.isabstract(value)
    }
    assert models <= set(dir(hysid))
    assert all(getattr(hysid, name) is not None for name in dir(hysid))


def test_a_report_is_one_file(tmp_path: Path):
    fit = hysid.fit(U, Y, **HOW)
    file = hysid.report(fit, tmp_path / "out.html")
    page = file.read_text("utf-8")
    assert "LinearSponge" in page
    assert str(tmp_path) not in page
    assert [x.name for x in tmp_path.iterdir()] == ["out.html"]


def test_double_precision_is_met_once():
    code = (
        "import hysid\n"
        "u = [0.0, 1.0, 2.0, 3.0] * 20\n"
        "try:\n"
        "    hysid.fit(u, [2 * x for x in u], model='LinearSponge')\n"
        "except hysid.InputError as error:\n"
        "    assert 'hysid.enable_x64()' in error.fix, error\n"
        "hysid.enable_x64()\n"
        "import jax.numpy\n"
        "assert jax.numpy.zeros(1).dtype == 'float64'\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
