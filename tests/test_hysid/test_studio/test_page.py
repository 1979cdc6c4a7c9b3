"""The page in a browser: from a dropped file to a downloaded header, and what must not happen on the way.

Skipped without Playwright or Chromium, which CHROMIUM names where it is not on the path.
"""

import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hysid
from tests.test_hysid.command import SPONGE, run
from tests.test_hysid.test_reporting.test_hostile_names import fitted
from tests.test_hysid.test_studio.served import serving

axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="axe is not installed")

SPANS = """() => {
  const { x, y } = document.querySelector(".plot").plot.u.scales;
  return [x.max - x.min, y.max - y.min];
}"""
PATIENCE = 60_000
"""Milliseconds: a busy machine starts a fit slowly."""
DROP = """([name, text]) => {
  const data = new DataTransfer();
  data.items.add(new File([text], name));
  dispatchEvent(new DragEvent("drop", { dataTransfer: data, bubbles: true, cancelable: true }));
}"""


@contextmanager
def opened(browser: Any, file: Path, at: str = "", but: str = "no fault") -> Iterator[Any]:
    """A studio's page of a new visitor, at a part of it; it complains of nothing, `but` of what has these
    words, and asks no other host."""
    faults: list[str] = []
    context = browser.new_context(viewport={"width": 1280, "height": 900}, reduced_motion="reduce")
    context.set_default_timeout(PATIENCE)
    page = context.new_page()
    page.on("pageerror", lambda error: faults.append(str(error)))
    page.on("console", lambda said: faults.append(said.text) if said.type == "error" else None)
    page.on("request", lambda asked: faults.append(asked.url) if foreign(asked.url) else None)
    with serving([file]) as ready:
        page.goto(ready.address + at)
        yield page, ready
        context.close()
    assert [fault for fault in faults if but not in fault] == []


def foreign(url: str) -> bool:
    return not url.startswith(("http://127.0.0.1:", "data:", "blob:"))


def serious(page: Any) -> list[tuple[str, str]]:
    """Faults of accessibility, each with an element that has it."""
    found = axe.Axe().run(page).response["violations"]
    return [
        (one["id"], one["nodes"][0]["html"])
        for one in found
        if one["impact"] in ("serious", "critical")
    ]


@pytest.mark.thorough
def test_from_a_dropped_file_to_a_downloaded_header(browser, tmp_path):
    with opened(browser, tmp_path) as (page, ready):
        page.evaluate(DROP, ["run.csv", SPONGE.read_text()])
        page.get_by_role("heading", name="run.csv").wait_for()
        page.get_by_text("My own choice").click()
        page.get_by_label("LinearSponge", exact=True).check()
        page.get_by_role("button", name="Fit", exact=True).click()
        page.get_by_role("progressbar").wait_for()
        assert 'model = "LinearSponge"' in (tmp_path / "run.toml").read_text()
        # In the middle of the fit: the page is loaded again, and another one is opened.
        page.reload()
        page.get_by_role("button", name="Cancel").wait_for()
        other = page.context.new_page()
        other.goto(f"{ready.address}#run.csv")
        for one in (page, other):
            one.locator("#verdict").wait_for()
            assert "LinearSponge" in one.locator("#verdict").inner_text()
        assert len(ready.studio.jobs.listed()) == 1
        other.close()
        page.get_by_label("Draw the loop of straight line").check()
        page.get_by_text("straight line, on the training rows").wait_for()
        page.get_by_text("What if").click()
        page.get_by_label(re.compile("^compliance")).focus()
        page.keyboard.press("ArrowRight")
        page.get_by_text("with the sliders").wait_for()
        page.get_by_role("button", name="Export the compensator").click()
        with page.expect_download() as download:
            page.get_by_role("link", name="run.h").click()
        assert download.value.path().read_text() == (tmp_path / "run" / "run.h").read_text()
        assert serious(page) == []
        page.get_by_role("button", name="Use dark colours").click()
        assert serious(page) == []
        page.set_viewport_size({"width": 390, "height": 844})
        page.wait_for_timeout(300)
        assert page.evaluate("document.documentElement.scrollWidth") <= 390
    assert run("report", tmp_path / "run").code == 0
    for colours in ("light", "dark"):
        page = browser.new_page(color_scheme=colours, viewport={"width": 390, "height": 844})
        page.goto((tmp_path / "run" / "report.html").as_uri())
        assert serious(page) == []
        page.close()


def test_rows_are_chosen_by_mouse_and_by_keyboard(browser, tmp_path):
    shutil.copy(SPONGE, tmp_path / "run.csv")
    with opened(browser, tmp_path / "run.csv") as (page, _):
        plot = page.locator(".plot .u-over").first
        plot.wait_for()
        box = plot.bounding_box()
        page.mouse.move(box["x"] + 0.1 * box["width"], box["y"] + 40)
        page.mouse.down()
        page.mouse.move(box["x"] + 0.3 * box["width"], box["y"] + 60)
        page.mouse.up()
        page.get_by_role("button", name="Exclude").click()
        page.get_by_text("Excluded lines: ").wait_for()
        told = re.search(r'exclude_lines = \["(\d+)-(\d+)"', (tmp_path / "run.toml").read_text())
        first, last = map(int, told.groups())
        assert abs(first - 12) <= 1  # of 101 rows over the width
        assert abs(last - 31) <= 1
        page.get_by_role("button", name="Choose rows by their times").press("Enter")
        page.keyboard.type("480")
        page.keyboard.press("Tab")
        page.get_by_role("button", name="Hold out").press("Enter")
        page.get_by_text("rows chosen in the plot").first.wait_for(state="attached")
        assert 'test_lines = ["82-102"]' in (tmp_path / "run.toml").read_text()
        page.get_by_role("button", name="Exchange input and output").click()
        page.get_by_text("displacement (mm) → force (N)").wait_for()


def test_a_report_is_alive_where_scripts_run_and_a_picture_elsewhere(browser, tmp_path):
    faults: list[str] = []
    evil = "</script><img src=x onerror='window.hacked=1'>"
    hysid.report(fitted(evil, f"x {evil}"), tmp_path / "report.html")
    (tmp_path / "other.html").write_text("<script>window.hacked = 1</script>")
    with serving([tmp_path]) as ready:
        address = ready.address.split("?")[0]
        served = address + ready.sessions.link("report.html")
        for where in ((tmp_path / "report.html").as_uri(), served):
            page = browser.new_page()
            page.on("pageerror", lambda error: faults.append(str(error)))
            page.goto(where)
            assert serious(page) == []
            plot = page.locator(".live .u-over").first
            plot.scroll_into_view_if_needed()
            box = plot.bounding_box()
            assert not page.locator(".live img").first.is_visible()
            x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
            page.mouse.move(x, y)
            tip = page.locator(".tip").first.inner_text()
            assert re.fullmatch(r".+: -?[\d.e-]+, -?[\d.e-]+", tip)
            wide = page.evaluate(SPANS)
            page.mouse.down()
            page.mouse.move(x + box["width"] / 4, y + box["height"] / 4)
            page.mouse.up()
            np.testing.assert_allclose(page.evaluate(SPANS), np.divide(wide, 4), rtol=0.03)
            page.mouse.dblclick(x, y)
            np.testing.assert_allclose(page.evaluate(SPANS), wide)
            page.locator(".key button").first.press("Enter")
            assert page.locator(".key button").first.get_attribute("aria-pressed") == "false"
            page.emulate_media(media="print")
            assert page.locator(".live img").first.is_visible()
            assert not plot.is_visible()
            assert page.evaluate("window.hacked") is None
            page.goto(address + ready.sessions.link("other.html"))
            assert page.evaluate("window.hacked") is None
            page.close()
    still = browser.new_context(java_script_enabled=False).new_page()
    still.goto((tmp_path / "report.html").as_uri())
    assert still.locator("figure img").first.is_visible()
    still.context.close()
    assert faults == []


def test_a_hostile_file_is_shown_as_text(browser, tmp_path):
    evil = '<img src=x onerror="window.hacked=1">'
    rows = "".join(f"{k},{abs(k % 20 - 10)},{abs(k % 20 - 10) * 2 + k % 3}\n" for k in range(100))
    header = f'time (s),"{evil.replace(chr(34), chr(34) * 2)} (N)",</script><b>x (mm)\n'
    (tmp_path / "<svg onload=hacked=1>.csv").write_text(header + rows)
    (tmp_path / "noise.csv").write_bytes(bytes(range(256)) * 40)
    with opened(browser, tmp_path, but="422") as (page, _):
        page.get_by_role("button", name="<svg onload").click()
        cells = [page.get_by_role(role, name=evil) for role in ("cell", "rowheader")]
        cells[0].or_(cells[1]).first.wait_for()
        page.locator(".plot .u-over").first.wait_for()
        assert page.evaluate("window.hacked") is None
        assert page.locator("main img").count() == 0
        page.get_by_role("button", name="noise.csv").click()
        page.get_by_role("alert").first.wait_for()
        assert page.get_by_role("button", name="Fit", exact=True).is_disabled()
        # There is nothing to look at.
        assert page.get_by_role("button", name="Zoom in").count() == 0
