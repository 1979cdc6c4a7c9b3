"""`hysid.explore`: linked plots in a notebook, the rows chosen there, and every peak of many rows."""

import base64
import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import hysid
from tests.test_hysid.test_studio.test_controls import sponge

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
    assert (low, high) == pytest.approx((300, 540), abs=5)
    assert edges is None
    page.locator(".plot").first.press("+")
    assert page.evaluate("window.asked.view") is not None
    page.close()
    assert faults == []


def record(n: int, seed: int = 0) -> hysid.Record:
    x = np.arange(n) / 100
    u = np.sin(x) + 0.01 * np.random.default_rng(seed).normal(size=n)
    return hysid.Record.from_arrays(u, u**3, x, line=np.arange(2, n + 2))


def shown(of: hysid.Record, **asked: Any) -> tuple[np.ndarray, np.ndarray, bool]:
    """Clock, input, output, line and state of the rows of both plots; whether lines join the loops."""
    about, content = sent(hysid.explore(of), asked)
    cut = 5 * about["shapes"][0]
    time, loops = np.split(np.frombuffer(content), [cut])
    return time.reshape(5, -1), loops.reshape(5, -1), about["joined"]


@settings(max_examples=10)
@given(st.integers(2, 40_000), st.integers(0, 3))
def test_no_peak_of_a_view_is_lost(n: int, seed: int):
    one, rows = record(n, seed), slice(max(n // 5 - 1, 0), n)
    time, _, _ = shown(one, view=[one.time[n // 5], None])
    assert np.all(np.diff(time[3]) > 0)
    for column, seen in ((one.input, time[1]), (one.output, time[2])):
        assert (seen.min(), seen.max()) == (column[rows].min(), column[rows].max())
    assert time.shape[1] <= 6001


def test_a_stretch_of_few_rows_is_shown_whole():
    one = record(100_000)
    np.testing.assert_array_equal(shown(one, view=[10.0, 20.0])[0][3], one.line[999:2002])


def test_loops_are_joined_where_all_rows_are_shown_and_a_raster_elsewhere():
    _, few, joined = shown(record(500))
    assert joined
    assert few.shape[1] == 500
    one = record(100_000)
    _, many, joined = shown(one)
    assert not joined
    assert many.shape[1] <= 360 * 240
    # Each row is in the cell of one that is shown.
    cell = np.array([np.ptp(one.input) / 360, np.ptp(one.output) / 240])
    for k in range(0, 100_000, 997):
        at = np.array([[one.input[k]], [one.output[k]]])
        assert ((np.abs(many[1:3] - at) / cell[:, None]).max(axis=0) <= 1.0).any()


def test_a_box_of_loops_shows_its_rows_with_gaps_where_they_leave_it():
    one = record(3000)
    _, found, joined = shown(one, box=(0.0, 0.5, -1.0, 1.0))
    inside = set(one.line[(one.input >= 0) & (one.input <= 0.5)])
    assert joined
    assert inside <= set(found[3])
    np.testing.assert_array_equal(found[4][1:] >= 8, np.diff(found[3]) > 1)
