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

from tests.test_hysid.command import Result

from .._measure import Row, judged, noted

LONGEST, STUCK, LARGEST_KB = 5.0, 60, 1_000_000
"""Seconds of processor time of a case, seconds after which it is ended, growth of the process's memory."""

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
        if event in RUNS:
            self.seen.append(f"{event} {about!r:.200}")
        elif event == "open" and isinstance(about[2], int) and about[2] & (os.O_WRONLY | os.O_RDWR):
            place = Path(os.fsdecode(about[0])) if not isinstance(about[0], int) else Path()
            if not (self.home / place).resolve().is_relative_to(self.home):
                self.seen.append(f"writes {place}")


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
    tally = Tally()
    if not _watch:
        _watch.append(_Watch())

    def each(case: Any) -> None:
        begin, memory = time.process_time(), _memory()
        signal.setitimer(signal.ITIMER_REAL, STUCK)
        _watch[0].home = here
        try:
            ended = run(case)
        except _Stuck as error:
            ended = "! stuck"
            tally.failures.append(f"{case!r:.300}\n{''.join(traceback.format_exception(error))}")
        except Exception as error:
            ended = f"! {type(error).__name__}"
            tally.failures.append(f"{case!r:.300}\n{''.join(traceback.format_exception(error))}")
        finally:
            _watch[0].home = None
            signal.setitimer(signal.ITIMER_REAL, 0)
        took, grown = time.process_time() - begin, _memory() - memory
        tally.slowest = max(tally.slowest, took)
        if took > LONGEST or grown > LARGEST_KB:
            tally.failures.append(f"{case!r:.300}: {took:.1f} s, {grown / 1e3:.0f} MB")
        if _watch[0].seen or os.listdir("..") != [INSIDE]:
            tally.failures.append(f"{case!r:.300}: {_watch[0].seen} {os.listdir('..')}")
            _watch[0].seen.clear()
        tally.ended[ended] += 1

    def stuck(*_: object) -> None:
        raise _Stuck

    here, before = Path.cwd().resolve(), signal.signal(signal.SIGALRM, stuck)
    try:
        for begin in range(0, count, AT_ONCE):
            tried = settings(
                max_examples=min(AT_ONCE, count - begin), deadline=None, database=None,
                phases=[Phase.generate], suppress_health_check=SLOW,
            )(given(cases)(each))  # fmt: skip
            seed(1_000_000 * first + begin)(tried)()
    finally:
        signal.signal(signal.SIGALRM, before)
    return tally


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
