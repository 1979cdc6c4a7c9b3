"""Texts of commands as the page says them, and figures of a loop that its sliders move."""

import ast
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import identify
from hysid.figures._sliders import moved, sliders_of
from hysid.studio._controls import on_page, worded
from hysid.studio._shapes import STIFFNESS, WIDTH, handles_of, reshaped
from hysteresis import Burgers, InputError, Record, parameters
from hysteresis.rigs import SpongeRig

ROOT = Path(__file__).parents[3]
OPTION = re.compile(r"(?<![\w-])--[a-z]")


def said() -> list[str]:
    """Every text of the package that names an option."""
    return [
        node.value
        for package in ("hysteresis", "identify", "compensate", "hysid/intake", "hysid/commands")
        for file in sorted((ROOT / package).rglob("*.py"))
        for node in ast.walk(ast.parse(file.read_text("utf-8")))
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
        and "\n" not in node.value and OPTION.search(node.value)
    ]  # fmt: skip


def test_no_text_of_the_package_names_an_option_on_the_page():
    texts = said()
    assert len(texts) > 50
    for text in texts:
        assert not OPTION.search(on_page(text)), text
        assert on_page(text).strip(), text


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("Name the output (--output COL).", "Name the output (“output”)."),
        ("Give --time COL or --dt SECONDS, not both.", "Give “time” or “Time between samples”, not both."),
        ('Give them: hysid init FILE --input "COL" --output "COL".', "Give them: “input” and “output”."),
        ("Name another one (--out DIR), or use --overwrite.", "Name another one."),
        ("Fit again: hysid fit FILE.", "Fit again: “Fit”."),
        ("--hold needs one column.", "“Creep or relaxation” needs one column."),
        ("A well-known 5--6 case.", "A well-known 5--6 case."),
    ],
)  # fmt: skip
def test_controls_stand_in_place_of_options(text, shown):
    assert on_page(text) == shown


@settings(max_examples=20)
@given(st.dictionaries(st.sampled_from(["name", "columns", "command"]), st.text()))
def test_names_are_left_as_they_are(document):
    assert worded(document) == document
    assert worded({"columns": [{"name": "--input"}], "fix": "--input"}) == {
        "columns": [{"name": "--input"}], "fix": "“input”",
    }  # fmt: skip


def test_sliders_stay_within_bounds():
    model = Burgers(E1=1.0, eta1=2.0, E2=3.0, eta2=4.0)
    found = sliders_of(model, {"input": "N", "output": "mm", "time": "s"})
    assert {"E1", "eta1", "E2", "eta2"} <= {one.name for one in found}
    for one in found:
        assert one.low < one.value < one.high
        for end in (one.low, one.high):
            there = moved(model, {one.name: end})
            y = there.simulate(np.arange(5.0), np.arange(5.0))
            values = {name: value for name, _, value in parameters(there)}
            assert float(values[one.name]) == pytest.approx(end)
            assert np.isfinite(np.asarray(y)).all()


def test_sliders_move_the_figures_that_they_name():
    t, force, displacement, _ = SpongeRig().five_cycles(noise=0.05, seed=50)
    record = Record.from_arrays(force, displacement, t, input_unit="N", output_unit="mm")
    fit = identify.fit(record, "Preisach", test_cycles=1)
    known = {one["name"]: one["value"] for one in handles_of(fit)}
    assert {STIFFNESS, WIDTH} <= known.keys()
    plain = np.asarray(fit.predict(fit.train))
    np.testing.assert_allclose(reshaped(fit, fit.train, {}), plain, atol=1e-9)

    def figures(factors: dict[str, float]) -> dict[str, float | None]:
        residuals = reshaped(fit, fit.train, factors) - fit.train.output
        moved = replace(fit, residuals=residuals)
        return {one.name: one.value for one in moved.characteristics}

    before = figures({})
    wide, stiff = figures({WIDTH: 2.0}), figures({STIFFNESS: 2.0})
    assert wide[WIDTH] == pytest.approx(2 * before[WIDTH], rel=1e-3)
    assert wide[STIFFNESS] == pytest.approx(before[STIFFNESS], rel=0.1)
    assert stiff[STIFFNESS] == pytest.approx(2 * before[STIFFNESS], rel=0.1)
    assert stiff[WIDTH] == pytest.approx(before[WIDTH], rel=1e-3)
    for wrong in ({"offset": 1.0}, {STIFFNESS: 0.0}, {WIDTH: -1.0}, {WIDTH: 1e300}):
        with pytest.raises(InputError) as caught:
            reshaped(fit, fit.train, wrong)
        assert caught.value.code == "unknown-parameter"
