"""`hysid.explore`: linked plots in a notebook, and the rows that are chosen there."""

import base64
import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import hysid
from hysteresis.rigs import SpongeRig

pytest.importorskip("anywidget", reason="anywidget is not installed")

MODEL = """([about, bytes]) => {
  window.state = { said: "", chosen: [] };
  const heard = {};
  const buffer = Uint8Array.from(atob(bytes), (c) => c.charCodeAt(0)).buffer;
  const model = {
    get: (name) => window.state[name], set: (name, value) => { window.state[name] = value; },
    save_changes: () => {}, on: (name, does) => { heard[name] = does; }, off: () => {},
    send: (asked) => { window.asked = asked; heard["msg:custom"](about, [new DataView(buffer)]); },
  };
  explorer.render({ model, el: document.body });
}"""


def sponge() -> hysid.Record:
    t, force, displacement, _ = SpongeRig().five_cycles(noise=0.05, seed=50)
    return hysid.Record.from_arrays(force, displacement, t, input_unit="N", output_unit="mm")


def sent(explorer: Any, asked: dict) -> tuple[dict, bytes]:
    """What the kernel answers to a message of the page."""
    answers: list = []
    explorer.widget.send = lambda about, buffers: answers.append((about, buffers[0]))
    explorer._answer(asked)
    return answers[0]


def test_chosen_rows_are_excluded_or_held_out():
    record = sponge()
    explorer = hysid.explore(record)
    assert not explorer.rows.any()
    explorer.choose(100.0, 200.0)
    np.testing.assert_array_equal(explorer.rows, (record.time >= 100) & (record.time <= 200))
    np.testing.assert_array_equal(explorer.kept.mask, record.mask & ~explorer.rows)
    explorer.choose(None, None, (5.0, 10.0, 0.0, 99.0))
    train, test = explorer.split
    np.testing.assert_array_equal(test.mask, (record.input >= 5) & (record.input <= 10))
    np.testing.assert_array_equal(train.mask, ~test.mask)
    assert explorer.widget.said.startswith(f"{int(test.mask.sum())} of {len(record)}")


def test_a_record_whose_clock_begins_again_is_shown_by_its_rows():
    record = sponge()
    time = np.concatenate([record.time[:50], record.time[:51]])
    again = replace(record, time=time, starts=np.array([0, 50]), labels=("a", "b"))
    about, content = sent(hysid.explore(again), {"view": [20, 80]})
    assert about["names"]["x"] == "row"
    rows = np.frombuffer(content)[: about["shapes"][0]]
    assert (rows[0], rows[-1]) == (19, 81)


def test_the_script_draws_and_sends_what_is_chosen(browser):
    explorer = hysid.explore(sponge())
    about, content = sent(explorer, {})
    faults: list[str] = []
    page = browser.new_page()
    page.on("pageerror", lambda error: faults.append(str(error)))
    page.set_content("<!DOCTYPE html><html><body></body></html>")
    code = explorer.widget._esm.replace("export default {", "window.explorer = {")
    page.add_script_tag(content=code, type="module")
    page.add_style_tag(content=explorer.widget._css)
    page.wait_for_function("window.explorer")
    page.evaluate(MODEL, [json.loads(json.dumps(about)), base64.b64encode(content).decode()])
    assert page.locator("canvas").count() == 2
    box = page.locator(".u-over").first.bounding_box()
    page.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 20)
    page.mouse.down()
    page.mouse.move(box["x"] + 0.9 * box["width"], box["y"] + 30)
    page.mouse.up()
    low, high, edges = page.evaluate("window.state.chosen")
    assert low == pytest.approx(300, abs=5)
    assert high == pytest.approx(540, abs=5)
    assert edges is None
    page.locator(".plot").first.press("+")
    assert page.evaluate("window.asked.view") is not None
    page.close()
    assert faults == []
