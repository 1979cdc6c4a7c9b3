"""What a visitor of the page meets: questions, failures, trials, changed choices. Each in Chromium."""

import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.test_hysid.command import SPONGE, put, run
from tests.test_hysid.test_studio.test_page import opened, serious

OPTION = re.compile(r"(?<![\w-])--[a-z]")
SEEN = """(element) => { const { top, bottom } = element.getBoundingClientRect();
  return top >= 0 && top < innerHeight && bottom > 0; }"""
"""Whether the top of an element is in the window."""


@pytest.fixture(scope="module")
def fitted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a measurement, its configuration and its fit."""
    folder = tmp_path_factory.mktemp("fitted")
    shutil.copy(SPONGE, folder / "run.csv")
    assert run("init", folder / "run.csv").code == 0
    config = folder / "run.toml"
    config.write_text(config.read_text().replace('model = "auto"', 'model = "Preisach"'))
    assert run("fit", folder / "run.csv", "--config", config, "--out", folder / "run").code == 0
    return folder


@pytest.fixture
def there(fitted: Path, tmp_path: Path) -> Path:
    """A copy of it with a file that the fit has not seen, one that it has, and one without rows."""
    folder = shutil.copytree(fitted, tmp_path / "there")
    lines = SPONGE.read_text().splitlines(keepends=True)
    (folder / "new.csv").write_text("".join(lines[:90]))
    shutil.copy(SPONGE, folder / "again.csv")
    (folder / "empty.csv").write_text(lines[0])
    return folder


@pytest.fixture
def page(browser: Any, there: Path) -> Iterator[Any]:
    with opened(browser, there, "#run.csv", but="422") as (shown, _):
        shown.locator("#compensator-title").wait_for()
        yield shown


def words_of(page: Any) -> str:
    """All that the page says, without the lines to copy."""
    return page.evaluate("""() => { const copy = document.querySelector("main").cloneNode(true);
      copy.querySelectorAll("pre, script").forEach((one) => one.remove()); return copy.textContent; }""")


def test_a_trial_is_that_of_the_file_that_is_chosen(page):
    card = page.locator("section", has=page.locator("#compensator-title"))
    assert card.get_by_role("combobox").input_value() == "new.csv"
    assert "again.csv (the fit has seen it)" in card.get_by_role("combobox").inner_text()
    card.get_by_role("button", name="Try the compensator").click()
    card.locator(".verdict").wait_for()
    card.get_by_text("rows flagged").wait_for()
    assert "on new.csv" in card.inner_text()
    card.get_by_role("combobox").select_option("empty.csv")
    assert card.locator(".verdict").count() == 0
    card.get_by_role("button", name="Try the compensator").click()
    card.get_by_role("alert").wait_for()
    assert card.get_by_role("alert").evaluate(SEEN)
    assert card.locator(".verdict").count() == 0
    assert not OPTION.search(words_of(page))
    card.get_by_role("combobox").select_option("new.csv")
    assert "on new.csv" in card.locator(".verdict").inner_text()


def test_a_fit_of_other_choices_is_put_away(page, there):
    page.locator("#verdict").wait_for()
    page.get_by_label("Number of cycles held out").fill("2")
    page.keyboard.press("Tab")
    page.get_by_text("A fit of other choices").wait_for()
    assert not page.locator("#verdict").is_visible()
    assert "PASS" not in page.locator("#files").inner_text()
    page.get_by_label("Number of cycles held out").fill("1")
    page.keyboard.press("Tab")
    page.locator("#verdict").wait_for()
    page.get_by_label("A model with named constants").check()
    page.get_by_text("A fit of other choices").wait_for()
    assert not page.locator("#verdict").is_visible()
    page.get_by_label("My own choice").check()
    page.get_by_label("Preisach", exact=True).check()
    for name in ("LinearSponge", "Burgers", "FoamCurve", "BoucWen"):
        page.get_by_label(name, exact=True).uncheck()
    page.locator("#verdict").wait_for()
    (there / "run.csv").write_text(SPONGE.read_text() + "606,1.0,4.0,5\n")
    page.get_by_text("A fit of other choices").wait_for()


def test_a_file_that_cannot_be_decided_is_a_question(browser, tmp_path):
    t = np.arange(300)
    columns = [np.sin(t / 7), np.cos(t / 5) * t, np.sin(t / 3) + t / 100, np.sin(t / 7) ** 2]
    table = "\n".join(",".join(f"{x:.4f}" for x in row) for row in zip(*columns, strict=True))
    (tmp_path / "four.csv").write_text(f"a,b,c,d\n{table}\n")
    creep = "\n".join(f"{k / 10},{1 - np.exp(-k / 50):.5f}" for k in range(300))
    (tmp_path / "creep.csv").write_text(f"time (s),x (mm)\n{creep}\n")
    (tmp_path / "heat.csv").write_text(
        "time (s),T1 (degC),T2 (degC)\n"
        + "".join(f"{k},{20 + np.sin(k / 20):.3f},{21 + np.cos(k / 9):.3f}\n" for k in range(300))
    )
    with opened(browser, tmp_path, "#four.csv") as (page, _):
        page.get_by_label("Role of a", exact=True).wait_for()
        assert page.get_by_role("button", name="Fit", exact=True).is_disabled()
        assert not OPTION.search(words_of(page))
        assert serious(page) == []
        page.get_by_label("Role of a", exact=True).select_option("input")
        page.get_by_label("Unit of a", exact=True).wait_for()
        page.get_by_label("Role of c", exact=True).select_option("output")
        page.locator(".plot .u-over").first.wait_for()
        page.get_by_text("Held out for testing").locator("visible=true").first.wait_for()
        assert page.get_by_role("button", name="Fit", exact=True).is_enabled()
        assert 'input = "a"' in (tmp_path / "four.toml").read_text()
        page.get_by_role("button", name="creep.csv").click()
        page.get_by_label("Constant input").wait_for()
        assert not OPTION.search(words_of(page))
        page.get_by_label("Constant input").fill("5")
        page.keyboard.press("Tab")
        page.locator(".plot .u-over").first.wait_for()
        assert "step = 5" in (tmp_path / "creep.toml").read_text()
        page.get_by_role("button", name="heat.csv").click()
        page.get_by_label("Role of T1 (degC)").select_option("input")
        page.get_by_label("Unit of T1 (degC)").wait_for()
        page.get_by_label("Role of T2 (degC)").select_option("output")
        page.locator(".plot .u-over").first.wait_for()


def test_the_model_is_one_of_three_choices_and_sliders_are_those_of_the_loop(page, there):
    fit = page.locator("section", has=page.locator("#fit-title"))
    fit.get_by_text("My own choice").click()
    assert fit.get_by_role("checkbox").count() > 10
    fit.get_by_text("A model with named constants").click()
    page.get_by_text("A fit of other choices").wait_for()
    assert (fit.get_by_role("radio").count(), fit.get_by_role("checkbox").count()) == (3, 0)
    assert 'model = "LinearSponge,Burgers,FoamCurve,BoucWen"' in (there / "run.toml").read_text()
    page.get_by_text("A fit of other choices").click()
    page.get_by_text("What if … ?").click()
    sliders = page.locator("#verdict .sliders label").all_inner_texts()
    assert [text.split("\n")[0].strip() for text in sliders][:2] == ["stiffness", "loop width"]
    page.get_by_label("loop width").focus()
    page.keyboard.press("ArrowRight")
    page.get_by_text("with the sliders").wait_for()


def test_units_typed_by_hand_are_on_the_axes(browser, tmp_path):
    file = put(SPONGE.read_text().replace("force (N)", "force"), tmp_path / "run.csv")
    with opened(browser, file) as (page, _):
        for name, unit, label in (
            ("force", "kN", "force"),
            ("displacement (mm)", "m", "displacement"),
        ):
            page.get_by_label(f"Unit of {name}").fill(unit)
            page.keyboard.press("Tab")
            page.locator(f'.plot[aria-label*="{label} ({unit})"]').first.wait_for()


def test_every_state_is_accessible_in_both_colours_and_widths(page):
    page.locator("#verdict canvas").wait_for()
    page.evaluate("document.querySelectorAll('details').forEach((one) => { one.open = true; })")
    for width in (1280, 390):
        page.set_viewport_size({"width": width, "height": 844})
        for colours in ("light", "dark"):
            page.emulate_media(color_scheme=colours)
            page.wait_for_timeout(200)
            assert serious(page) == []
            assert page.evaluate("document.documentElement.scrollWidth") <= width
