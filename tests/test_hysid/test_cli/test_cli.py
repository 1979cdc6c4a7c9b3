"""The commands on good input: what --json promises, what lies in the folder, how a run ends."""

import subprocess
import sys
from pathlib import Path
from types import NoneType
from typing import Any

import numpy as np
import pytest

import hysid
import identify
from hysid.cli._app import app
from hysid.commands import _demo
from tests.test_hysid.command import (
    COLUMNS,
    ENVIRONMENT,
    LINE,
    F,
    X,
    blocks,
    put,
    read,
    refused,
    run,
    sponge,
)

METRICS = dict.fromkeys(("rmse", "nrmse_percent", "max_abs", "r2"), float)
PARAMETER = {"name": str, "value": float, "unit": str, "stderr": float | NoneType, "status": str}
CANDIDATE = {
    "model": str, "parameters": [PARAMETER], "metrics": {"train": METRICS, "test": METRICS},
    "verdict": {"level": str, "reasons": [{"code": str, "text": str, "values": dict}]},
}  # fmt: skip
FIT = CANDIDATE | {
    "schema": int, "candidates": [CANDIDATE], "data": {"sha256": str, "rows": int}, "seed": int,
    "versions": {"python": str, "jax": str},
}  # fmt: skip
DRAWN = {"name": str} | dict.fromkeys(("mean", "sd", "q05", "q95", "rhat", "ess"), float)
POSTERIOR = {"parameters": [DRAWN], "draws": int, "seconds": float}
PREDICTED = METRICS | {"flagged": int, "file": str}


def fits(value: Any, shape: Any) -> bool:
    """Has a JSON value at least these keys, with these types?"""
    if isinstance(shape, dict):
        there = isinstance(value, dict) and shape.keys() <= value.keys()
        return there and all(fits(value[k], s) for k, s in shape.items())
    if isinstance(shape, list):
        return isinstance(value, list) and value and all(fits(v, shape[0]) for v in value)
    return isinstance(value, shape) and not isinstance(value, bool)


def numbers(rows: list[dict[str, str]], name: str) -> np.ndarray:
    return np.array([float(row[name]) for row in rows])


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """One block; two blocks; half of the columns."""
    place = tmp_path_factory.mktemp("cli")
    lines = put(sponge(), place / "run.csv").read_text().splitlines()
    cells = [line.split(",") for line in lines]
    put(blocks(), place / "blocks.csv")
    put("\n".join(f"{row[0]},{row[1]}" for row in cells), place / "forces.csv")
    put("\n".join(f"{row[0]},{row[2]}" for row in cells), place / "depths.csv")
    return place


@pytest.fixture(scope="module")
def fitted(folder) -> dict[str, Any]:
    models = ("--model", "LinearSponge,Preisach", "--test-cycles", 1, "--out", folder / "out")
    return run("fit", folder / "run.csv", *COLUMNS, *models, *LINE[2:], "--json").json()


@pytest.fixture(scope="module")
def each(folder) -> dict[str, Any]:
    options = ("--each", "block", "--test-tail", 0.2, *LINE)
    words = ("fit", folder / "blocks.csv", *COLUMNS, *options, "--out", folder / "each", "--json")
    assert run(*words).code == 0
    again = run(*words, "--overwrite").json()
    assert not [*(folder / "each").rglob("*.new.*")]
    return again


def test_fit_prints_what_it_wrote(fitted, folder):
    assert fits(fitted, FIT)
    assert fitted["schema"] == 1
    assert fitted["model"] == "Preisach"
    assert [c["model"] for c in fitted["candidates"]] == ["Preisach", "LinearSponge"]
    assert fitted["verdict"]["level"] == "PASS"
    assert fitted["metrics"]["test"]["nrmse_percent"] < 1
    assert fitted["data"]["rows"] == 101
    written = {file.name for file in (folder / "out").iterdir()}
    assert written == {"fit.json", "model.npz", "data.npz", "fit.npz"}


def test_a_fit_whose_compensator_is_interrupted_is_kept(folder, monkeypatch):
    def stopped(fit):
        raise KeyboardInterrupt

    monkeypatch.setattr("hysid.commands._fit.with_compensator", stopped)
    words = ("fit", folder / "run.csv", *COLUMNS, *LINE, "--out", folder / "cut", "--json")
    assert run(*words).json()["verdict"]["level"] == "CAUTION"
    monkeypatch.setattr("hysid._compensator.judged_to_compensate", stopped)
    told = run(*words, "--purpose", "compensate", "--overwrite").json()["verdict"]["reasons"]
    assert "interrupted" in [reason["code"] for reason in told]
    monkeypatch.setattr("identify.fitting._fit.with_repeatability", stopped)
    assert "before its noise was chosen" in run(*words, "--overwrite").err
    monkeypatch.undo()
    assert run("predict", folder / "cut", folder / "run.csv", "--inverse", "--json").code == 0


@pytest.mark.parametrize("inverse", [False, True])
def test_predict_writes_a_row_for_every_row(fitted, folder, inverse):
    option = ("--inverse",) * inverse
    found = run("predict", folder / "out", folder / "run.csv", *option, "--json").json()
    assert fits(found, PREDICTED)
    rows = read(found["file"])
    name, result = (F, f"estimated {F}") if inverse else (X, f"predicted {X}")
    measured, error = numbers(rows, name), numbers(rows, result) - numbers(rows, name)
    assert [int(row["line"]) for row in rows] == list(range(2, 103))
    assert np.array_equal(measured, numbers(read(folder / "run.csv"), name))
    assert found["rmse"] == pytest.approx(np.sqrt(np.mean(error**2)))
    assert found["max_abs"] == pytest.approx(np.abs(error).max())
    assert found["nrmse_percent"] == pytest.approx(100 * found["rmse"] / np.ptp(measured))
    assert found["nrmse_percent"] < 3
    assert found["flagged"] == sum(row["status"] != "OK" for row in rows)
    alone = run("predict", folder / "out", folder / f"{'depths' if inverse else 'forces'}.csv",
                *option, "--json").json()  # fmt: skip
    assert dict.fromkeys(METRICS) == {key: alone[key] for key in METRICS}
    assert np.array_equal(numbers(read(alone["file"]), result), numbers(rows, result))
    more = ["standard deviation"] * inverse
    assert list(read(alone["file"])[0]) == ["line", X if inverse else F, result, "status", *more]


@pytest.mark.parametrize("inverse", [False, True])
def test_predict_begins_in_the_state_that_known_rows_tell(fitted, folder, inverse):
    option = ("--inverse",) * inverse
    known = run("predict", folder / "out", folder / "run.csv", "--known", "30", *option, "--json")
    rows = read(known.json()["file"])
    name, result = (F, f"estimated {F}") if inverse else (X, f"predicted {X}")
    error = (numbers(rows, result) - numbers(rows, name))[30:]
    assert known.json()["rmse"] == pytest.approx(np.sqrt(np.mean(error**2)))
    assert known.json()["nrmse_percent"] < 3
    assert np.isfinite(numbers(rows, "standard deviation")).all()
    assert known.json()["flagged"] == sum(row["status"] != "OK" for row in rows[30:])
    if inverse:
        assert rows[0]["status"] != "OK"
        assert rows[30]["status"] == "OK"
        assert known.json()["compensator"]["ok_after"] == {"cycles": 0, "time": 0}
        assert known.json()["notes"][-1].startswith("From the known rows on, ")
    else:
        assert "30 known rows" in " ".join(known.json()["notes"])


def test_each_value_gets_its_own_fit(each, folder):
    assert list(each["each"]) == ["soft", "thin"]
    assert all(fits(one, FIT) for one in each["each"].values())
    assert each["model"] == "LinearSponge"
    for part in ("train", "test"):
        rmse = [one["metrics"][part]["rmse"] for one in each["each"].values()]
        assert each["metrics"][part]["rmse"] == pytest.approx(np.mean(rmse))
    assert {file.parent.name for file in (folder / "each").rglob("fit.npz")} == {"soft", "thin"}


def test_each_is_predicted_and_sampled_by_its_own_fit(each, folder):
    found = run("predict", folder / "each", folder / "blocks.csv", "--json").json()
    assert fits(found, PREDICTED)
    rows = read(found["file"])
    assert [row["block"] for row in rows] == ["soft"] * 101 + ["thin"] * 101
    backwards = run("predict", folder / "each", folder / "blocks.csv", "--inverse").out
    assert "Note: thin: Switched on at the first row" in backwards
    drawn = run("sample", folder / "each", "--steps", 40, "--ensembles", 2, "--json").json()
    assert fits(drawn, POSTERIOR)
    assert {"soft: K", "thin: K"} <= {p["name"] for p in drawn["parameters"]}
    words = ("sample", folder / "each", "--steps", 40, "--ensembles", 2)
    refused(run(*words), "(--resume)", "[would-overwrite]")
    said = run(*words, "--overwrite")
    assert "\nthin: Posterior: " in said.out
    assert "Not converged" in said.out
    assert "--resume --steps 80 --ensembles 2 --seed 0\n" in said.out
    assert ", thin, acceptance" in said.err
    assert "sampling: " in said.err
    assert (folder / "each" / "thin" / "posterior.nc").is_file()


def test_a_line_stores_no_reversals(each, folder):
    asked = run("export", folder / "each" / "soft", "--c", folder / "soft.h", "--depth", 8)
    refused(asked, "--depth has no effect", "[bad-option]")


def test_sampling_that_is_interrupted_goes_on_to_the_steps_asked_for(each, folder, monkeypatch):
    def stopped(self, done, *_):
        if done >= 20:
            raise KeyboardInterrupt

    monkeypatch.setattr("hysid.commands._console.Progress.__call__", stopped)
    words = ("sample", folder / "each" / "soft", "--steps", 900, "--ensembles", 2, "--overwrite")
    assert "--resume --steps 900 --ensembles 2 --seed 0\n" in run(*words).out


@pytest.mark.parametrize(("options", "train", "test"), [
    (("--group", "block", "--test-where", "block=thin"), 101, 101),
    (("--group", "block", "--test-where", "cycle%2=0"), 122, 80),
    (("--where", "block=thin", "--test-tail", "0.2"), 80, 21),
    (("--where", "block=soft", "--where", "cycle=1,2"), 41, 0),
], ids=["a group", "cycles", "a tail", "two conditions"])  # fmt: skip
def test_rows_are_used_and_held_out_as_asked(folder, tmp_path, options, train, test):
    model = (*LINE, "--out", tmp_path / "out")
    data = run("fit", folder / "blocks.csv", *COLUMNS, *options, *model, "--json").json()["data"]
    assert (data["rows_train"], data["rows_test"]) == (train, test)


def test_of_each_value_the_rows_that_it_has_are_held_out(folder, tmp_path):
    options = ("--each", "block", "--test-where", "block=thin", *LINE, "--out", tmp_path / "out")
    assert run("fit", folder / "blocks.csv", *COLUMNS, *options).code == 0
    kept = identify.load(tmp_path / "out" / "soft")
    assert (len(kept.train), kept.test) == (101, None)


def test_where_there_is_no_json_people_can_read_it(folder, tmp_path):
    model = (*LINE, "--out", tmp_path / "out")
    said = run("fit", folder / "run.csv", *COLUMNS, *model)
    assert said.out.startswith("CAUTION: LinearSponge (to predict)\n  ")
    assert said.out.endswith(f"Results: {tmp_path / 'out'}\n")
    assert "LinearSponge: held-out" in said.err
    for line in (said.out + said.err).splitlines():
        assert line.strip()


COMMANDS = [command.callback.__name__ for command in app.registered_commands if command.callback]

GROUPS = [group.name for group in app.registered_groups]


@pytest.mark.parametrize(
    "arguments",
    [(), ("--help",), *((one,) for one in GROUPS), *((one, "--help") for one in COMMANDS)],
)
def test_help(arguments):
    said = run(*arguments)
    assert (said.code, said.err) == (0, "")
    assert said.out.startswith("Usage: hysid")


def test_demo_speaks_before_it_loads_jax(tmp_path):
    # -X importtime names each module on stderr as soon as it is imported.
    command = [sys.executable, "-X", "importtime", "-m", "hysid", "demo", "--out", "demo"]
    imported = []
    piped = {"stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen(command, cwd=tmp_path, env=ENVIRONMENT, **piped) as process:
        for line in process.stderr:
            if line.startswith("hysid demo"):
                break
            imported.append(line.split("|")[-1].strip())
        process.kill()
    assert "hysid.cli._app" in imported
    assert not {name.split(".")[0] for name in imported} & {"jax", "jaxlib", "numpy", "scipy"}


def test_the_demo_makes_the_shipped_record_where_it_is_not(tmp_path: Path):
    shipped = _demo.DATASETS / "sponge-50mm-mixed-cycles.csv"
    assert _demo.demo_data(tmp_path) == shipped
    made = _demo.demo_data(tmp_path / "out", datasets=tmp_path)
    assert made.read_bytes() == shipped.read_bytes()


def test_a_fit_saved_from_python_is_run_by_the_command_line(tmp_path: Path):
    file = put(sponge(), tmp_path / "a.csv")
    record = hysid.read_csv(file, input=F, output=X, time="time (s)")
    line = hysid.fit(record, "LinearSponge", test_cycles=1, noise="gaussian", starts=2)
    hysid.save(line, tmp_path / "fit")
    found = run("predict", tmp_path / "fit", file, "--json").json()
    # A line through the loop: 8 % of its range, and the first cycle a little more.
    assert found["nrmse_percent"] < 15
    # A fit of the command line keeps what it was asked for.
    given = (*COLUMNS, "--model", "LinearSponge", "--where", "cycle=1", "--out", tmp_path / "b")
    run("fit", file, *given)
    hysid.save(hysid.load(tmp_path / "b"), tmp_path / "c")
    b, c = (identify.internal.read_document(tmp_path / name) for name in "bc")
    assert (c["selection"], c["options"]) == (b["selection"], b["options"])
    assert c["selection"]["where"] == ["cycle=1"]
