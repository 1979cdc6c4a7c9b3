"""Commands killed at random moments: every result is the old one or the new one, whole."""

import contextlib
import json
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import identify
from compensate.runtime import load
from tests.test_hysid.command import COLUMNS, ENVIRONMENT, put, run, sponge, text

from .._measure import Row, judged, noted

# One process imports everything and forks for each command: the import takes most of a command's time. It
# must not have computed anything before, because XLA's threads do not survive a fork.
SERVER = """
import os, sys, json, time
import jax, identify, compensate, h5netcdf, matplotlib.figure
from hysid.cli._app import main
import hysid.operations._fit, hysid.operations._predict, hysid.operations._export
import hysid.operations._sample, hysid.operations._batch
import hysid.reporting._fit_page, hysid.reporting._specimens_page
print("ready", flush=True)
for line in sys.stdin:
    words = json.loads(line)
    pid = os.fork()
    if not pid:
        os.setsid()
        sys.argv = ["hysid", *words]
        null = os.open(os.devnull, os.O_RDWR)
        for k in (0, 1, 2):
            os.dup2(null, k)
        code = 0
        try:
            main()
        except SystemExit as stop:
            code = stop.code or 0
        os._exit(code)
    print(pid, flush=True)
    _, status = os.waitpid(pid, 0)
    print(status, flush=True)
"""

FIT = (
    "--model",
    "LinearSponge",
    "--noise",
    "gaussian",
    "--starts",
    "2",
    "--out",
    "out",
    "--overwrite",
)
COMMANDS: dict[str, tuple[str, ...]] = {
    "fit": ("fit", "run.csv", *COLUMNS, *FIT),
    "report": ("report", "out"),
    "predict": ("predict", "out", "run.csv"),
    "export": ("export", "out", "--c", "it.h", "--runtime", "it.json"),
    "sample": ("sample", "out", "--steps", "60", "--ensembles", "2"),
    "batch": ("batch", "data/*.csv", "--config", "it.toml", "--out", "all", "--no-resume"),
    "fit --each": (
        "fit",
        "each.csv",
        *COLUMNS,
        "--each",
        "cycle",
        *FIT[:-3],
        "--out",
        "each",
        "--overwrite",
    ),
}
CONFIGURATION = f"""[selection]
input = "{COLUMNS[1]}"
output = "{COLUMNS[3]}"
time = "{COLUMNS[5]}"

[fit]
model = "LinearSponge"
noise = "gaussian"
starts = 2
"""


def _put_files() -> None:
    """What the commands read."""
    rows = sponge(4.0)
    put(text(rows))
    put(text([row for row in rows if row[-1] in ("1", "2")]), "each.csv")
    put(CONFIGURATION, "it.toml")
    Path("data").mkdir()
    for name in ("a", "b"):
        put(text(rows), f"data/{name}.csv")


def _whole() -> Iterator[str]:
    """What is wrong with the results in the current folder."""
    for place in Path("all").glob("*/fit.json"):
        try:
            identify.load(place.parent)
        except Exception as error:
            yield f"batch: {error}"
    table = Path("all/batch.csv")
    if table.exists() and not table.read_text().endswith("\n"):
        yield "table of a batch: cut off"
    try:
        several = identify.internal.read_document("each")
        for value, one in several["each"].items():
            seconds = identify.load(Path("each", several["folders"][value])).seconds
            if seconds != one["seconds"]:
                yield f"fit --each: {value} is of another time than the table"
    except Exception as error:
        yield f"fit --each: {error}"
    try:
        identify.load("out")
        identify.load_posterior("out")
    except Exception as error:
        yield f"fit: {error}"
    report = Path("out/report.html")
    if report.exists() and not report.read_text("utf-8").rstrip().endswith("</html>"):
        yield "report: cut off"
    predicted = Path("out/predicted-run.csv")
    rows = len(Path("run.csv").read_text().splitlines())
    if predicted.exists() and len(predicted.read_text().splitlines()) != rows:
        yield "prediction: cut off"
    if Path("it.h").exists() and not Path("it.h").read_text().rstrip().endswith("*/"):
        yield "header: cut off"
    if Path("it.json").exists():
        try:
            load("it.json")
        except Exception as error:
            yield f"runtime: {error}"


def kills(count: int) -> list[Row]:
    """SIGKILL and SIGTERM at moments spread over each command; the folder is then read."""
    _put_files()
    for words in COMMANDS.values():
        said = run(*words)
        assert said.code == 0, said.err
    whole = list(_whole())
    assert not whole, whole
    server = subprocess.Popen(
        [sys.executable, "-c", SERVER], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        env=ENVIRONMENT | {"JAX_PLATFORMS": "cpu"}, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    assert server.stdin is not None
    assert server.stdout is not None
    out = server.stdout
    out.readline()

    def start(words: tuple[str, ...]) -> int:
        server.stdin.write(json.dumps(words) + "\n")  # type: ignore[union-attr]
        server.stdin.flush()  # type: ignore[union-attr]
        return int(out.readline())

    took: dict[str, float] = {}
    for name, words in COMMANDS.items():
        begin = time.perf_counter()
        start(words)
        status = int(out.readline())
        took[name] = time.perf_counter() - begin
        assert status == 0, (name, status)
    moments, lost, killed, before = random.Random(0), [], 0, _ages()
    for k in range(count):
        name = list(COMMANDS)[k % len(COMMANDS)]
        # Half of the kills aim at the writing, which is at the end.
        moment = moments.uniform(0.0, 1.05) if k % 2 else moments.uniform(0.8, 1.05)
        pid = start(COMMANDS[name])
        time.sleep(took[name] * moment)
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL if k % 3 else signal.SIGTERM)
        killed += int(out.readline()) != 0
        lost += [f"{name} after {moment:.2f}: {said}" for said in _whole()]
    server.stdin.close()
    server.wait()
    out.close()
    for said in lost[:3]:
        print(said, file=sys.stderr)
    left = [p.name for p in Path("out").iterdir() if ".new" in p.name]
    return [
        judged(f"kills of {', '.join(COMMANDS)}: results lost or cut off, of {count}", len(lost), 0),
        noted(
            f"    ended by the kill; {len(_ages() - before)} files changed, {len(left)} left beside", killed
        ),
    ]  # fmt: skip


def _ages() -> set[tuple[str, int]]:
    return {(str(p), p.stat().st_mtime_ns) for p in Path().rglob("*") if p.is_file()}


def full_disk() -> list[Row]:
    """Every write fails as on a full disk: the old results stay, and the command says so in one line."""
    put(text(sponge(4.0)))
    assert run(*COMMANDS["fit"]).code == 0
    wrong, tried = [], ("fit", "report", "predict", "export")
    for name in tried:
        words = COMMANDS[name]
        before = {p: p.read_bytes() for p in Path().rglob("*") if p.is_file()}
        with _refusing():
            said = run(*words)
        after = {p: p.read_bytes() for p in Path().rglob("*") if p.is_file()}
        if (
            said.code != 2
            or said.err.count("\n") < 1
            or "File too large" not in said.err
            or before != after
        ):
            wrong.append(f"{name}: exit {said.code} {said.err}")
    for said in wrong[:3]:
        print(said, file=sys.stderr)
    return [
        judged(f"a full disk under {len(tried)} commands: results lost or not said", len(wrong), 0)
    ]


class _refusing:  # noqa: N801 - a context, as the others
    """Within it no file of more than 100 bytes can be written: the system's limit on a file's size."""

    def __enter__(self) -> None:
        import resource  # not on Windows

        self.before = resource.getrlimit(resource.RLIMIT_FSIZE)
        self.handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (100, self.before[1]))

    def __exit__(self, *_: object) -> None:
        import resource

        resource.setrlimit(resource.RLIMIT_FSIZE, self.before)
        signal.signal(signal.SIGXFSZ, self.handler)
