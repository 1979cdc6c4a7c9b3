"""Running many made-up cases: how each must end, and what is counted."""

import contextlib
import os
import resource
import signal
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st

from hysteresis.records.importers import _apart
from tests.test_hysid.command import Result

from .._measure import Row, judged, noted

LONGEST, STUCK, LARGEST_KB = 5.0, 60, 1_000_000
"""Seconds of processor time of a case, and at which it is ended; growth of the process's memory."""

AT_ONCE = 1000
"""Cases of one seed: Hypothesis remembers all of them, and takes longer for each."""

SLOW = (HealthCheck.too_slow, HealthCheck.data_too_large, HealthCheck.large_base_example)

RUNS = ("os.system", "os.exec", "os.posix_spawn", "os.fork", "subprocess.Popen", "pickle.find_class",
        "socket.connect", "ctypes.dlopen")  # fmt: skip
"""Events of Python that no file may cause."""


@dataclass
class Tally:
    """How cases ended: by code, or as a failure with what was seen."""

    ended: Counter[str] = field(default_factory=Counter)
    failures: list[str] = field(default_factory=list)
    slowest: float = 0.0

    def rows(self, what: str) -> list[Row]:
        """The count tried is in each row's text; the first failures go to stderr."""
        for said in self.failures[:3]:
            print(f"{what}: {said[-1500:]}", file=sys.stderr)
        count = sum(self.ended.values())
        kinds = sum(1 for code in self.ended if code != "read")
        return [
            judged(f"{what}: failures, of {count:,}", len(self.failures), 0),
            noted(
                f"    read, in percent; {kinds} kinds of refusal, the slowest took {self.slowest:.1f} s",
                100 * self.ended["read"] / max(count, 1),
            ),
        ]


class _Stuck(BaseException):
    """A case that does not end; nothing that catches errors catches this."""


class _Watch:
    """What cases do that files may not: run something, or write outside of the current folder."""

    def __init__(self) -> None:
        self.home: Path | None = None
        self.seen: list[str] = []
        sys.addaudithook(self._heard)

    def _heard(self, event: str, about: tuple[Any, ...]) -> None:
        if self.home is None:
            return
        if event in RUNS and not _importing() and not _reads_apart(event, about):
            self.seen.append(f"{event} {about!r:.200}")
        elif event == "open" and isinstance(about[2], int) and about[2] & (os.O_WRONLY | os.O_RDWR):
            place = Path(os.fsdecode(about[0])) if not isinstance(about[0], int) else Path()
            if not (self.home / place).resolve().is_relative_to(self.home) and not _importing():
                self.seen.append(f"writes {place}")


def _reads_apart(event: str, about: tuple[Any, ...]) -> bool:
    """Whether it is one of our own readers, whose words no file chooses: see SECURITY.md."""
    return event == "subprocess.Popen" and about[1][:3] == [sys.executable, "-P", _apart.__file__]


def _importing() -> bool:
    """Whether a library is being imported, late; what it runs then is its own."""
    frame: Any = sys._getframe()
    while frame is not None:
        if frame.f_code.co_filename == "<frozen importlib._bootstrap>":
            return True
        frame = frame.f_back
    return False


_watch: list[_Watch] = []  # such a hook stays as long as the process


def one_line(said: Result) -> bool:
    """Refused as a user is: exit 2, nothing on stdout, one line that ends in a code."""
    lines = said.err.splitlines()
    return (said.code, said.out, len(lines)) == (2, "", 1) and lines[0].endswith("]")


def fuzz(
    cases: st.SearchStrategy[Any], count: int, run: Callable[[Any], str], first: int = 0
) -> Tally:
    """`run` every case; it returns how the case ended and raises where it ended badly.

    `first`: the seed of the first cases. Others are other cases.
    """
    with judging(run) as (each, tally):
        for begin in range(0, count, AT_ONCE):
            tried = settings(
                max_examples=min(AT_ONCE, count - begin), deadline=None, database=None,
                phases=[Phase.generate], suppress_health_check=SLOW,
            )(given(cases)(each))  # fmt: skip
            seed(1_000_000 * first + begin)(tried)()
    return tally


@contextlib.contextmanager
def judging(run: Callable[[Any], str]) -> Iterator[tuple[Callable[[Any], None], Tally]]:
    """What runs and judges one case, and how all of them ended; the current folder is watched."""
    tally = Tally()
    if not _watch:
        _watch.append(_Watch())

    now, memory = 0, _memory()
    looked = (-1, 0.0)

    def each(case: Any) -> None:
        nonlocal now, memory
        now += 1
        begin = time.perf_counter()
        try:
            if now == 1:  # what is done once: programs are compiled, the machine is looked at
                run(case)
            ended = watched(case)
        except _Stuck as error:
            ended = "! stuck"
            tally.failures.append(f"{case!r:.300}\n{''.join(traceback.format_exception(error))}")
        except Exception as error:
            ended = f"! {type(error).__name__}"
            tally.failures.append(f"{case!r:.300}\n{''.join(traceback.format_exception(error))}")
        took = time.perf_counter() - begin
        if took > LONGEST and not ended.startswith("!"):
            # Another process may have had the processor. The clock of this one alone is slow to ask.
            begin = time.process_time()
            watched(case)
            took = time.process_time() - begin
        tally.slowest = max(tally.slowest, took)
        if took > LONGEST:
            tally.failures.append(f"{case!r:.300}: {took:.1f} s")
        if _watch[0].seen:
            tally.failures.append(f"{case!r:.300}: {_watch[0].seen}")
            _watch[0].seen.clear()
        if now % 50 == 0 and (grown := _memory() - memory) > 0:
            memory += grown
            if grown > LARGEST_KB:
                tally.failures.append(f"one of 50 before {case!r:.300}: {grown / 1e3:.0f} MB")
        tally.ended[ended] += 1

    def watched(case: Any) -> str:
        _watch[0].home = here
        try:
            return run(case)
        finally:
            _watch[0].home = None

    def stuck(*_: object) -> None:
        nonlocal looked
        if looked[0] != now:
            looked = now, time.process_time()
        elif _watch[0].home is not None and time.process_time() - looked[1] > STUCK:
            raise _Stuck

    def unraisable(about: Any) -> None:
        """What the end of an object raises is printed with its traceback, and nothing catches it."""
        _watch[0].seen.append(f"unraisable {about.exc_value!r:.200}")

    heard, sys.unraisablehook = sys.unraisablehook, unraisable
    here, before = Path.cwd().resolve(), signal.signal(signal.SIGPROF, stuck)
    signal.setitimer(signal.ITIMER_PROF, 5.0, 5.0)
    try:
        yield each, tally
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)
        sys.unraisablehook = heard
    if os.listdir("..") != [INSIDE]:
        tally.failures.append(f"left outside: {os.listdir('..')}")


def _memory() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def told(said: Result) -> str:
    """How a command ended: "read", or its code. Raises `AssertionError` for any other end."""
    if said.code == 0:
        assert "Traceback" not in said.err, said.err
        return "read"
    if not one_line(said):
        # A usage error has no code: click's words, one line.
        usage = (
            said.code == 2
            and not said.out
            and said.err.count("\n") == 1
            and "See: hysid" in said.err
        )
        assert usage, f"exit {said.code}: {said.err}"
        return "usage"
    assert "bug in hysid" not in said.err, said.err
    return said.err.rpartition("[")[2].strip("]\n")


INSIDE = "inside"


@contextlib.contextmanager
def elsewhere() -> Iterator[None]:
    """An empty folder to work in, alone in another one."""
    before = os.getcwd()
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder, INSIDE)
        place.mkdir()
        os.chdir(place)
        try:
            yield
        finally:
            os.chdir(before)
