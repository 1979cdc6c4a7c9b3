"""Commands killed at random moments: every result is the old one or the new one, whole."""

import contextlib
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import identify
from compensate.runtime import load
from identify import load_posterior
from tests.test_hysid.command import COLUMNS, ENVIRONMENT, put, run, sponge, text
from tests.test_hysid.test_studio.served import ask, entered

from .._measure import Row, judged, noted

# One process imports everything and forks for each command: the import takes most of a command's time. It
# must not have computed anything before, because XLA's threads do not survive a fork.
SERVER = """
import os, sys, json, time
import jax, identify, compensate, h5netcdf, matplotlib.figure
from hysid.cli._app import main
import hysid.commands._fit, hysid.commands._predict, hysid.commands._export
import hysid.commands._sample, hysid.commands._batch, hysid.intake._init
import hysid.reporting._report, hysid.reporting._specimens_page
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
    "init": ("init", "run.csv", "--overwrite"),
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


PATIENCE = 120.0
"""Seconds in which a command ends."""
NOBODY = 65534
"""A user who owns nothing."""


def _put_files() -> None:
    """What the commands read."""
    rows = sponge(4.0)
    put(text(rows))
    put(text([row for row in rows if row[-1] in ("1", "2")]), "each.csv")
    put(CONFIGURATION, "it.toml")
    Path("data").mkdir(exist_ok=True)
    for name in ("a", "b"):
        put(text(rows), f"data/{name}.csv")


def _whole() -> Iterator[str]:
    """What is wrong with the results in the current folder."""
    if Path("run.toml").exists():
        try:
            tomllib.loads(Path("run.toml").read_text("utf-8"))["selection"]["output"]
        except (ValueError, KeyError) as error:
            yield f"init: {error}"
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
        load_posterior("out")
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
    again = []
    for name, words in COMMANDS.items():
        start(words)
        again += [name] if int(out.readline()) else []
    again += _whole()
    server.stdin.close()
    server.wait()
    out.close()
    for said in lost[:3]:
        print(said, file=sys.stderr)
    left = [p.name for p in Path("out").iterdir() if ".new" in p.name]
    return [
        judged(f"kills of {', '.join(COMMANDS)}: results lost or cut off, of {count}", len(lost), 0),
        judged(f"... commands that fail afterwards {', '.join(again)}".rstrip(), len(again), 0),
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


def _started(*words: str, **how: Any) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "hysid", *words], env=ENVIRONMENT, text=True, start_new_session=True,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, **how,
    )  # fmt: skip


def _ended(command: subprocess.Popen[str], fine: tuple[int, ...]) -> str:
    """What is wrong with the end of a command: its status, or other than one line for a refusal."""
    said = command.communicate(timeout=PATIENCE)[1]
    words = said.rpartition("hysid: ")[2]
    told = command.returncode != 2 or (words.count("\n") == 1 and ".new-" not in words)
    good = command.returncode in fine and told and "Traceback" not in said
    return "" if good else f"exit {command.returncode}: {said[-300:]}"


def children(tries: int) -> list[Row]:
    """A batch of two processes and a studio whose fit runs, ended: who goes on, and what is there then."""
    _put_files()
    for name in ("fit", "sample", "fit --each"):
        assert run(*COMMANDS[name]).code == 0
    batch = (
        "batch",
        "data/*.csv",
        "--config",
        "it.toml",
        "--out",
        "all",
        "--no-resume",
        "--jobs",
        "2",
    )
    wrong, moments = [], random.Random(1)
    for k in range(tries):
        number = (signal.SIGTERM, signal.SIGKILL)[k % 2]
        command = _started(*batch)
        time.sleep(moments.uniform(1.0, 12.0))
        command.send_signal(number)
        # Its workers hold its pipes: they end when the last process does.
        if bad := _ended(command, (0, 130, -number)):
            wrong.append(f"batch: {bad}")
        studio = _started("studio", "run.csv", "--no-browser", "--json")
        assert studio.stdout is not None
        address = json.loads(studio.stdout.readline())["address"]
        secret = entered(address)
        for path, body in (("look", {}), ("start", {"kind": "fit"})):
            answer = ask(address, f"/api/{path}", {"name": "run.csv", **body}, X_Hysid=secret)
            assert answer.status == 200, answer
        time.sleep(moments.uniform(0.0, 8.0))
        job = _children(studio.pid)
        studio.send_signal(number)
        if bad := _ended(studio, (0, 130, -number)):
            wrong.append(f"studio: {bad}")
        # A killed studio cannot end its commands: they end by themselves.
        until = time.monotonic() + (PATIENCE if number == signal.SIGKILL else 0.5)
        while (left := [one for one in job if _runs(one)]) and time.monotonic() < until:
            time.sleep(0.1)
        wrong += [f"studio: {len(left)} left after {number}"] if left else []
        wrong += _whole()
    for again in (batch, ("fit", "run.csv", *COLUMNS, *FIT)):
        if bad := _ended(_started(*again), (0,)):
            wrong.append(f"again: {bad}")
    for said in [*wrong, *_whole()][:3]:
        print(said, file=sys.stderr)
    what = f"batches of two processes and studios, ended by SIGTERM and SIGKILL, of {2 * tries}"
    return [judged(f"{what}: processes left, results damaged", len(wrong), 0)]


def _children(parent: int) -> list[int]:
    return [
        int(word) for word in Path(f"/proc/{parent}/task/{parent}/children").read_text().split()
    ]


def _runs(process: int) -> bool:
    with contextlib.suppress(OSError):
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    return False


def folders_changed(tries: int) -> list[Row]:
    """Two writers of one folder, folders that vanish, and folders that cannot be written into."""
    _put_files()
    shutil.copy("data/a.csv", "other.csv")
    moments, mixed = random.Random(2), []
    for k in range(tries):
        shutil.rmtree("out", ignore_errors=True)
        two = []
        for name, starts in (("run.csv", "2"), ("other.csv", "3")):
            two.append(_started("fit", name, *COLUMNS, *FIT[:5], starts, *FIT[6:]))
            time.sleep(moments.uniform(0.0, 0.5))
        mixed += [bad for bad in (_ended(one, (0, 2)) for one in two) if bad]
        try:
            identify.load("out")
            report = run("report", "out")
            mixed += [report.err] if report.code else []
            said = Path("out/fit.json").read_text("utf-8")
            mixed += [f"{k}: of two files"] if ("run.csv" in said) == ("other.csv" in said) else []
        except Exception as error:
            mixed.append(f"{k}: {error}")
    unsaid = []
    for k in range(tries):
        assert run(*COMMANDS["fit"]).code == 0
        name = ("fit", "report", "predict", "export", "sample")[k % 5]
        command = _started(*COMMANDS[name])
        time.sleep(moments.uniform(1.0, 6.0))
        shutil.rmtree("out", ignore_errors=True)
        unsaid += [f"{name}: {bad}" for bad in [_ended(command, (0, 2))] if bad]
    assert run(*COMMANDS["fit"]).code == 0
    before = _ages()
    with _read_only(Path.cwd()) as user:
        for name in ("init", "fit", "report", "predict", "export", "sample", "batch"):
            if bad := _ended(_started(*COMMANDS[name], user=user), (2,)):
                unsaid.append(f"read-only, {name}: {bad}")
    written = len(_ages() - before)
    for said in [*mixed, *unsaid][:5]:
        print(said, file=sys.stderr)
    return [
        judged(
            f"two writers of one folder, of {tries}: mixtures, and ends without words",
            len(mixed),
            0,
        ),
        judged(
            f"folders that vanish, of {tries}, or are read-only, of 7: commands that do not say",
            len(unsaid),
            0,
        ),
        judged("... files written into read-only folders", written, 0),
    ]


@contextlib.contextmanager
def _read_only(folder: Path) -> Iterator[int | None]:
    """No folder below can be written into; the user to do so as, where this one may do all."""
    places = [folder, *(p for p in folder.rglob("*") if p.is_dir())]
    for place in places:
        place.chmod(0o555)
    try:
        yield NOBODY if os.getuid() == 0 else None
    finally:
        for place in places:
            place.chmod(0o755)
