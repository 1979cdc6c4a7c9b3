"""A browser, for the tests of pages; they are skipped without Playwright or Chromium."""

import os
import shutil
from collections.abc import Iterator
from typing import Any

import pytest


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    playwright = pytest.importorskip("playwright.sync_api", reason="Playwright is not installed")
    known = map(shutil.which, ("chromium", "chromium-browser"))
    chromium = os.environ.get("CHROMIUM") or next(filter(None, known), None)
    if chromium is None:
        pytest.skip("there is no chromium; install it, or name it in CHROMIUM")
    with playwright.sync_playwright() as started:
        found = started.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        yield found
        found.close()
