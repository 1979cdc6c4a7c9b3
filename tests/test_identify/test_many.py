"""Many records: as one by one, over any executor, and whatever happens to some of them."""

import json
import os
import signal
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import identify
from hysteresis import Burgers, InputError, LinearSponge, Record
from tests.refusals import refuses
from tests.thorough import rest_thorough

SAME = {"conditioning": "keep", "clocks": "keep", "noise": "gaussian"}
SPONGE = LinearSponge(0.3, 0.0)


def sponge(seed: int, rows: int = 120) -> Record:
    """Three cycles of a noisy line."""
    random, t = np.random.default_rng(seed), np.linspace(0, 3, rows)
    u = 10 - 10 * np.cos(2 * np.pi * t)
    y = random.uniform(0.2, 0.5) * u + random.normal() + 0.05 * random.normal(size=rows)
    return Record.from_arrays(u, y, time=t, source=f"run {seed}")


def near(value: Any, off: float) -> Any:
    """A cell of a table, as good as equal where it is a number."""
    close = {"rel": off, "abs": off, "nan_ok": True}
    return pytest.approx(value, **close) if isinstance(value, float) else value


def creeping(seed: int) -> Record:
    random, t = np.random.default_rng(seed), np.linspace(0, 60, 150)
    u = 5 - 5 * np.cos(2 * np.pi * t / 15)
    truth = Burgers(2 + random.uniform(), 90.0, 3.0, 12.0 + random.uniform())
    y = np.asarray(truth.simulate(t, u)) + 0.01 * random.normal(size=len(t))
    return Record.from_arrays(u, y, time=t)


@pytest.mark.parametrize(
    "model", rest_thorough([SPONGE, "LinearSponge", LinearSponge(0.3, 0.0, 5.0)], 1)
)
def test_a_line_has_the_row_of_its_fit(model):
    """In closed form, but for what the fit alone tells; the last one is not sure to be a line."""
    records = [sponge(seed) for seed in range(5)]
    records[1] = replace(records[1], mask=np.arange(120) % 7 > 0)
    records += [sponge(9, rows=100), sponge(8, rows=12)]
    batch = identify.fit_many(records, model, **SAME)
    alone = identify.fit_many(records, model, **SAME, starts=3)
    assert [name for name, _ in batch] == [str(k) for k in range(7)]
    for k, (row, own) in enumerate(zip(batch.table(), alone.table(), strict=True)):
        assert ("verdict" in row) == (k == 6)
        # Levenberg and Marquardt stop at 1e-10 of the step; the line's minimum is exact.
        assert row == {key: near(own[key], 1e-6) for key in row}


@pytest.mark.parametrize("model", rest_thorough([SPONGE, Burgers(1.0, 50.0, 1.0, 5.0, 0.0)], 1))
def test_a_fit_is_that_of_a_single_record(model):
    record = creeping(1)
    ((_, one),) = identify.fit_many([record], model, starts=2)
    other = identify.fit(record, model, starts=2)
    for name in ("parameters", "score", "verdict"):
        assert getattr(one, name) == getattr(other, name)
    assert str(one.noise_model) == str(other.noise_model)


def test_a_bad_one_is_named_and_stops_nothing():
    records = {f"run {k}": sponge(k) for k in range(9)}
    records["flat"] = replace(sponge(3), input=np.zeros(120))
    records["short"] = sponge(4, rows=6)
    noise = np.random.default_rng(0).normal(size=(2, 120))
    records["noise"] = Record.from_arrays(*noise)
    unread = InputError("nan-output", "3 NaN in the output")

    class Lazy:
        def items(self):
            yield from records.items()
            yield "unread", unread
            yield "run 1", sponge(1)

    batch = identify.fit_many(Lazy(), SPONGE, **SAME)
    assert list(batch.fits) == [f"run {k}" for k in range(9)]
    codes = {name: error.code for name, error in batch.failed.items()}
    assert codes.pop("noise") in ("too-few-rows", "no-excitation")
    assert codes == {
        "flat": "constant-input", "short": "too-few-rows", "unread": "nan-output",
        "run 1": "given-twice",
    }  # fmt: skip
    assert [row["name"] for row in batch.table() if "error" in row] == list(batch.failed)


def test_ctrl_c_ends_a_batch_and_no_fit_that_it_cut_short_is_kept(monkeypatch):
    """A single fit would give its best candidate so far."""
    t = np.linspace(0, 10, 100)
    u = 10 - 10 * np.cos(2 * np.pi * t / 2.5)
    record = Record.from_arrays(u, 0.3 * u, time=t)

    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("identify.fitting._linear.GridCandidate.fitted", interrupted)
    said: list[str] = []
    with pytest.raises(KeyboardInterrupt):
        identify.fit_many([record] * 2, "LinearSponge, Preisach", starts=2, progress=said.append)
    assert said == []


def test_what_is_done_is_not_done_again(tmp_path):
    records = {f"run-{k}": sponge(k) for k in range(3)}
    first = identify.fit_many(dict([*records.items()][:2]), SPONGE, out=tmp_path)
    assert first.skipped == []
    stamp = (tmp_path / "run-0" / "fit.json").stat().st_mtime_ns
    records["run-1"] = sponge(7)  # other data of that name
    second = identify.fit_many(records, SPONGE, out=tmp_path)
    assert second.skipped == ["run-0"]
    assert (tmp_path / "run-0" / "fit.json").stat().st_mtime_ns == stamp
    assert list(second.fits) == ["run-0", "run-1", "run-2"]
    np.testing.assert_array_equal(second.fits["run-1"].train.output, sponge(7).output)
    assert {p.name for p in tmp_path.iterdir()} == {*records, "batch.json", "batch.csv"}
    refuses("other-settings", lambda: identify.fit_many(records, SPONGE, out=tmp_path, seed=3))
    other = identify.fit_many({"run-9": sponge(9), "bad-name/..": sponge(1)}, SPONGE, out=tmp_path)
    assert list(other.fits) == ["run-9"]
    table = (tmp_path / "batch.csv").read_text("utf-8").splitlines()
    assert [row.split(",")[0] for row in table[1:]] == ["run-9", *records, "bad-name/.."]
    file, told = tmp_path / "batch.json", json.loads((tmp_path / "batch.json").read_text("utf-8"))
    file.write_text(json.dumps(told | {"fits": [1]}), "utf-8")
    refuses("damaged-file", lambda: identify.fit_many(records, SPONGE, out=tmp_path))
    again = identify.fit_many(records, SPONGE, out=tmp_path, seed=3, resume=False)
    assert again.skipped == []
    odd = identify.fit_many({"../away": sponge(1)}, SPONGE, out=tmp_path, seed=3)
    assert odd.failed["../away"].code == "bad-name"


def saved(record: Record, folder: str, marker: str, *, test: Record | None) -> identify.FitResult:
    """A fit that was made before; the process that is first asked for the run named `marker` dies."""
    file = Path(folder) / marker
    if record.source == "run 3" and (marker == "always" or not file.exists()):
        file.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return identify.load(folder)


@pytest.fixture(scope="module")
def one_fit(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("fit")
    batch = identify.fit_many([sponge(0)], SPONGE)
    return identify.save(batch.fits["0"], folder / "one")


def spread(executor, folder: Path, marker: str) -> identify.FitResult:
    """Six records, one of which kills the process that fits it."""
    records = {f"run {k}": sponge(k) for k in range(6)}
    how = {"function": saved, "folder": str(folder), "marker": marker}
    return identify.fit_many(records, executor=executor, **how)


def processes(count: int = 2) -> ProcessPoolExecutor:
    return ProcessPoolExecutor(count, get_context("spawn"))


@pytest.mark.thorough
def test_a_pool_that_broke_is_made_anew(one_fit):
    batch = spread(processes, one_fit, "once")
    assert (batch.failed, list(batch.fits)) == ({}, [f"run {k}" for k in range(6)])
    assert batch.fits["run 3"].parameters[:2] == identify.load(one_fit).parameters[:2]


@pytest.mark.thorough
def test_the_record_that_kills_every_process_is_named(one_fit):
    # One process at a time: each takes seconds to start, and several die.
    batch = spread(lambda: processes(1), one_fit, "always")
    assert {name: error.code for name, error in batch.failed.items()} == {"run 3": "worker-lost"}
    assert len(batch) == 5


@pytest.mark.thorough
def test_threads_and_dask_give_the_same_and_a_killed_worker_loses_nothing(one_fit):
    from distributed import Client, LocalCluster

    records = [sponge(seed) for seed in range(4)]
    serial = identify.fit_many(records, SPONGE).table()
    with ThreadPoolExecutor(2) as threads:
        tables = [identify.fit_many(records, SPONGE, executor=threads).table()]
    with (
        LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0") as cluster,
        Client(cluster) as client,
    ):
        executor = client.get_executor(pure=False)
        tables += [identify.fit_many(records, SPONGE, executor=executor).table()]
        batch = spread(executor, one_fit, "dask")
    for table in tables:
        for one, other in zip(table, serial, strict=True):
            assert one == {key: near(value, 1e-9) for key, value in other.items()}
    assert batch.failed == {}
    assert len(batch) == 6


def odd(record: Record, *, test: Record | None) -> identify.FitResult:
    if record.source == "run 0":
        raise ValueError("no")
    return identify.fit(record, SPONGE, **SAME)


def test_work_that_raises_is_told_from_work_that_was_lost():
    batch = identify.fit_many([sponge(0), sponge(1)], function=odd)
    assert (batch.failed["0"].code, list(batch.fits)) == ("fit-broke", ["1"])
    assert "ValueError: no" in batch.failed["0"].problem
