"""Many records: side by side as one by one, over any executor, and whatever happens to some of them."""

import os
import signal
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pytest

import identify
from hysteresis import Burgers, InputError, LinearSponge, Note, Record
from identify.batch import _fit_many as _many
from identify.batch._executor import Unit, done_by
from tests.thorough import rest_thorough

SAME = {"conditioning": "keep", "clocks": "keep", "noise": "gaussian"}
SPONGE = LinearSponge(0.3, 0.0)


def sponge(seed: int, rows: int = 120) -> Record:
    """Three cycles of a noisy line."""
    random = np.random.default_rng(seed)
    t = np.linspace(0, 3, rows)
    u = 10 - 10 * np.cos(2 * np.pi * t)
    y = random.uniform(0.2, 0.5) * u + random.normal() + 0.05 * random.normal(size=rows)
    return Record.from_arrays(u, y, time=t, source=f"run {seed}")


def creeping(seed: int) -> Record:
    random = np.random.default_rng(seed)
    t = np.linspace(0, 60, 150)
    u = 5 - 5 * np.cos(2 * np.pi * t / 15)
    truth = Burgers(2 + random.uniform(), 90.0, 3.0, 12.0 + random.uniform())
    y = np.asarray(truth.simulate(t, u)) + 0.01 * random.normal(size=len(t))
    return Record.from_arrays(u, y, time=t)


def same(one: identify.FitResult, other: identify.FitResult, tolerance: float) -> None:
    """Two fits of a record, but for what is left out side by side."""
    assert one.name == other.name
    for p, q in zip(one.parameters, other.parameters, strict=True):
        assert (p.name, p.unit, p.status) == (q.name, q.unit, q.status)
        for a, b in ((p.value, q.value), (p.stderr, q.stderr), (p.low, q.low), (p.high, q.high)):
            assert (a is None) == (b is None)
            if a is not None and b is not None and not np.isnan(b):
                assert a == pytest.approx(b, rel=max(tolerance, 1e-5), abs=tolerance)
    np.testing.assert_allclose(one.covariance, other.covariance, rtol=100 * tolerance)
    # Where the sum of squares is least it hardly changes with the parameters.
    np.testing.assert_allclose(one.residuals, other.residuals, atol=tolerance)
    # By itself it is sought, to 1e-7 of the likelihood; side by side it has a closed form.
    assert one.noise.sigma == pytest.approx(other.noise.sigma, rel=1e-5)
    assert one.metrics["train"] == pytest.approx(other.metrics["train"], rel=1e-4)
    assert one.success == other.success
    # Side by side no part of the rows is held out, so there is nothing to compare baselines on.
    on_folds = {"nothing-held-out", "baseline-better", "best-baseline"}
    said, other_said = (
        [reason for reason in v.reasons if Note.of(reason).code not in on_folds]
        for v in (one.verdict, other.verdict)
    )
    assert (one.verdict.level, said) == (other.verdict.level, other_said)
    assert np.isnan(one.score)


@pytest.mark.parametrize("model", rest_thorough([SPONGE, "LinearSponge"], 1))
def test_a_line_is_fitted_as_by_itself(model):
    records = [sponge(seed) for seed in range(5)]
    # One with rows that do not count, one of another length.
    records[1] = replace(records[1], mask=np.arange(120) % 7 > 0)
    records.append(sponge(9, rows=100))
    batch = identify.fit_many(records, model)
    assert [name for name, _ in batch] == [str(k) for k in range(6)]
    for record, (_, one) in zip(records, batch, strict=True):
        # Levenberg and Marquardt stop at 1e-10 of the step; the line's minimum is exact.
        same(one, identify.fit(record, model, **SAME), 1e-6)


@pytest.mark.thorough
def test_a_model_that_is_no_line_is_fitted_as_by_itself():
    start = Burgers(1.0, 50.0, 1.0, 5.0, 0.0)
    records = [creeping(seed) for seed in range(3)]
    batch = identify.fit_many(records, start, starts=4)
    for record, (_, one) in zip(records, batch, strict=True):
        same(one, identify.fit(record, start, starts=4, **SAME), 1e-4)


def test_the_table_says_what_the_fits_say():
    batch = identify.fit_many([sponge(1), sponge(2)], SPONGE, names=["a", "b"])
    for row, (name, fit) in zip(batch.table(), batch, strict=True):
        assert row["name"] == name
        assert row["trusted"] == fit.trusted
        assert fit.metrics["train"] is not None
        assert row["nrmse_percent"] == pytest.approx(fit.metrics["train"].nrmse_percent)
        for p in fit.parameters:
            if p.status != "fixed":
                assert row[p.name] == pytest.approx(p.value)
                assert row[f"{p.name} stderr"] == pytest.approx(p.stderr)
                assert row[f"{p.name} status"] == p.status


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

    batch = identify.fit_many(Lazy(), SPONGE)
    assert list(batch.fits) == [f"run {k}" for k in range(9)]
    codes = {name: error.code for name, error in batch.failed.items()}
    assert codes.pop("noise") in ("too-few-rows", "no-excitation")
    assert codes == {
        "flat": "constant-input", "short": "too-few-rows", "unread": "nan-output",
        "run 1": "given-twice",
    }  # fmt: skip
    assert [row["name"] for row in batch.table() if "error" in row] == list(batch.failed)


def test_what_breaks_side_by_side_is_tried_alone(monkeypatch):
    def breaks(*_: object) -> None:
        raise MemoryError

    monkeypatch.setattr(_many, "fit_together", breaks)
    batch = identify.fit_many([sponge(1), sponge(2)], SPONGE)
    assert [fit.success for _, fit in batch] == [True, True]
    assert not np.isnan(batch.fits["0"].score)


def test_ctrl_c_ends_a_batch_and_no_fit_that_it_cut_short_is_kept(monkeypatch):
    """A single fit would give its best candidate so far."""
    t = np.linspace(0, 10, 100)
    u = 10 - 10 * np.cos(2 * np.pi * t / 2.5)
    record = Record.from_arrays(u, 0.3 * u, time=t)

    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("identify.fitting._linear.fit_grid", interrupted)
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
    with pytest.raises(InputError, match=r"other-settings"):
        identify.fit_many(records, SPONGE, out=tmp_path, seed=3)
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
    return identify.fit_many(
        records, executor=executor, function=saved, folder=str(folder), marker=marker
    )


def processes(count: int = 2) -> ProcessPoolExecutor:
    return ProcessPoolExecutor(count, get_context("spawn"))


@pytest.mark.thorough
def test_a_pool_that_broke_is_made_anew(one_fit):
    batch = spread(processes, one_fit, "once")
    assert batch.failed == {}
    assert list(batch.fits) == [f"run {k}" for k in range(6)]
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
        tables = [identify.fit_many(records, SPONGE, executor=threads, chunk=2).table()]
    with (
        LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0") as cluster,
        Client(cluster) as client,
    ):
        executor = client.get_executor(pure=False)
        tables += [identify.fit_many(records, SPONGE, executor=executor, chunk=2).table()]
        batch = spread(executor, one_fit, "dask")
    for table in tables:
        for one, other in zip(table, serial, strict=True):
            assert one.keys() == other.keys()
            for key, value in one.items():
                # Chunks of another size round otherwise.
                alike = (
                    pytest.approx(other[key], rel=1e-9) if isinstance(value, float) else other[key]
                )
                assert value == alike
    assert batch.failed == {}
    assert len(batch) == 6


def test_work_that_raises_is_told_from_work_that_was_lost():
    def fails() -> None:
        raise ValueError("no")

    units = [Unit(("a",), fails, ()), Unit(("b",), int, ("7",))]
    outcomes = {unit.names[0]: outcome for unit, outcome in done_by(units)}
    assert isinstance(outcomes["a"], ValueError)
    assert outcomes["b"] == 7
