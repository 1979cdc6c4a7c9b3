"""Running many made-up cases: how each must end, and what is counted."""

import contextlib
import os
import resource
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st

from tests.test_hysid.command import Result

from .._measure import Row, judged, noted

LONGEST, LARGEST_KB = 5.0, 1_000_000
"""Seconds of a case, and growth of the process's memory by it."""


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
                f"    read, in percent; {kinds} kinds of refusal",
                100 * self.ended["read"] / max(count, 1),
            ),
        ]


def one_line(said: Result) -> bool:
    """Refused as a user is: exit 2, nothing on stdout, one line that ends in a code."""
    lines = said.err.splitlines()
    return (said.code, said.out, len(lines)) == (2, "", 1) and lines[0].endswith("]")


def fuzz(cases: st.SearchStrategy[Any], count: int, run: Callable[[Any], str]) -> Tally:
    """`run` every case; it returns how the case ended and raises where it ended badly."""
    tally = Tally()

    @seed(0)
    @settings(
        max_examples=count, deadline=None, database=None, phases=[Phase.generate],
        suppress_health_check=[*HealthCheck.__members__.values()],
    )  # fmt: skip
    @given(cases)
    def each(case: Any) -> None:
        begin, memory = time.perf_counter(), _memory()
        try:
            ended = run(case)
        except Exception as error:
            ended = f"! {type(error).__name__}"
            tally.failures.append(f"{case!r:.300}\n{''.join(traceback.format_exception(error))}")
        took, grown = time.perf_counter() - begin, _memory() - memory
        tally.slowest = max(tally.slowest, took)
        if took > LONGEST or grown > LARGEST_KB:
            tally.failures.append(f"{case!r:.300}: {took:.1f} s, {grown / 1e3:.0f} MB")
        tally.ended[ended] += 1

    each()
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


@contextlib.contextmanager
def elsewhere() -> Iterator[None]:
    """An empty folder to work in."""
    before = os.getcwd()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        try:
            yield
        finally:
            os.chdir(before)
