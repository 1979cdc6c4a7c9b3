"""The page of `hysid studio` on a large file: first plot, pan and zoom, in headless Chromium.

python -m benchmarks.studio [--quick] [--json]

A table of a million rows, with `--quick` of a hundred thousand, is chosen in the page, which a process of
its own serves. Seconds are those on the wall, from the click or the key to the frame that shows the rows,
or those of the server's processor. CHROMIUM names the browser where it is not on the path.
"""

import importlib.util
import json
import math
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ._measure import Row, judged, noted, options, report
from .reading import PIECE, write_rows

FIRST, MOVE = 2.0, 0.1
"""Seconds to the first plot, and of a pan or a zoom."""
KEYS = (
    "+",
    "ArrowRight",
    "+",
    "ArrowRight",
    "-",
    "ArrowLeft",
    "+",
    "+",
    "ArrowRight",
    "-",
    "-",
    "0",
)
PATIENCE = 120_000
"""Milliseconds."""
_DRAWN = """async () => {
  const drawn = () => document.querySelector('.plots[aria-busy="false"] .u-over');
  while (!drawn()) await new Promise(requestAnimationFrame);
  await new Promise(requestAnimationFrame);
}"""
_CHOSEN = f"""async (name) => {{
  const button = [...document.querySelectorAll("#files button")].find((one) => one.dataset.name === name);
  const begin = performance.now();
  button.click();
  await ({_DRAWN})();
  return (performance.now() - begin) / 1000;
}}"""
_PRESSED = f"""async (key) => {{
  const plot = document.querySelector(".plots .plot[tabindex]");
  const begin = performance.now();
  plot.dispatchEvent(new KeyboardEvent("keydown", {{ key, bubbles: true, cancelable: true }}));
  await ({_DRAWN})();
  return (performance.now() - begin) / 1000;
}}"""


def main(arguments: Sequence[str] | None = None) -> None:
    """Serve the page, choose the file, move about, and print."""
    chosen = options("benchmarks.studio", __doc__, arguments)
    rows = PIECE // 10 if chosen.quick else PIECE
    if chromium() is None:
        why = "there is no Chromium or no Playwright"
        report([noted(f"first plot of {rows:,} rows: seconds", math.nan, reason=why)], chosen.json)
        return
    with tempfile.TemporaryDirectory() as folder:
        write_rows(Path(folder) / "run.csv", rows)
        with _served(Path(folder)) as (address, server), _page(address) as page:
            report(_measured(page, server, rows), chosen.json)


def _measured(page: Any, server: int, rows: int) -> list[Row]:
    before = _processor(server)
    begin = time.perf_counter()
    first = page.evaluate(_CHOSEN, "run.csv")  # of an excerpt, while a thread reads the rest
    page.wait_for_function(
        "() => /Over time\\. /.test(document.querySelector('.plots figcaption').textContent)",
        timeout=PATIENCE,
    )
    whole = time.perf_counter() - begin
    page.get_by_text("The record in words").wait_for()
    used = _processor(server) - before
    moves = [page.evaluate(_PRESSED, key) for key in KEYS]
    return [
        judged(f"first plot of {rows:,} rows: seconds", first, FIRST),
        noted("plot of all of them: seconds", whole),
        noted("reading and judging all of them: processor seconds of the server", used),
        judged("pan or zoom: median seconds", statistics.median(moves), MOVE, min(moves)),
        noted("pan or zoom: the slowest of 12, seconds", max(moves)),
    ]


@contextmanager
def _served(folder: Path) -> Iterator[tuple[str, int]]:
    """The address of a studio of the folder, and the number of its process."""
    command = [sys.executable, "-m", "hysid", "studio", str(folder), "--no-browser", "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            yield json.loads(process.stdout.readline())["address"], process.pid
        finally:
            process.terminate()


@contextmanager
def _page(address: str) -> Iterator[Any]:
    """The page, in a browser without a window."""
    from playwright.sync_api import sync_playwright  # with the tests alone

    with sync_playwright() as started:
        browser = started.chromium.launch(executable_path=chromium(), args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1280, "height": 900})
        page.set_default_timeout(PATIENCE)
        page.goto(address)
        page.locator("#files button").first.wait_for()
        yield page
        browser.close()


def chromium() -> str | None:
    """The browser that is driven, None where it or what drives it is not installed."""
    there = importlib.util.find_spec("playwright") is not None
    return (os.environ.get("CHROMIUM") or shutil.which("chromium")) if there else None


def _processor(process: int) -> float:
    """Seconds of processor time that a process has taken, by its own count."""
    words = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")


if __name__ == "__main__":
    main()
