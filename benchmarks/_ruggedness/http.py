"""The server of the studio: wrong requests, changes at the same time, and what another port can use."""

import contextlib
import math
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tests.test_hysid.command import COLUMNS, put, run, sponge, text
from tests.test_hysid.test_studio.attempts import lost_changes, usable_elsewhere
from tests.test_hysid.test_studio.malformed import tried
from tests.test_hysid.test_studio.served import entered, serving

from .._measure import Row, judged, noted
from ..studio import chromium

FIT = ("--model", "LinearSponge", "--noise", "gaussian", "--starts", 2, "--out", "run")


def rows(count: int, first: int) -> list[Row]:
    """So many wrong requests to a studio with a fit, fifty changes, and every way in that is known."""
    put(text(sponge()))
    assert run("fit", "run.csv", *COLUMNS, *FIT).code == 0
    Path("out").symlink_to("/")
    Path("loop").symlink_to("loop")
    with serving([Path.cwd()]) as ready:
        answers = tried(ready, count, first)
    for said in answers.faults[:3]:
        print(said, file=sys.stderr)
    with serving([Path.cwd()]) as ready:
        lost = lost_changes(ready, entered(ready.address))
    with serving([Path.cwd()]) as ready, _browser() as browser:
        ways = usable_elsewhere(ready, browser)
    missing = "there is no Chromium or no Playwright"
    sent = noted("what a browser sends to another port", math.nan, reason=missing)
    return [
        judged(f"wrong requests to the studio: status 500, of {count:,}", answers.failed, 0),
        judged("... without words or without an answer", len(answers.faults), 0),
        judged("changes of a configuration at the same time: lost, of 50", lost, 0),
        judged("ways into the studio from another port, of all that are tried", len(ways), 0),
        *([] if browser else [sent]),
    ]


@contextlib.contextmanager
def _browser() -> Iterator[Any]:
    """Chromium, None where it or what drives it is not installed."""
    if (name := chromium()) is None:
        yield None
        return
    from playwright.sync_api import sync_playwright  # with the tests alone

    with sync_playwright() as started:
        found = started.chromium.launch(executable_path=name, args=["--no-sandbox"])
        yield found
        found.close()
