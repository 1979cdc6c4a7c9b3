"""Texts of commands as the page says them, and figures of a loop that its sliders move."""

import ast
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import identify
from hysid.studio._requests import on_page, worded
from hysteresis import Burgers, Record
from hysteresis.rigs import SpongeRig
from tests.refusals import refuses
from tests.sources import trees
from tests.test_hysid.test_studio.served import studio_of

NAMES = ("E1", "eta1", "E2", "eta2", "offset")
STIFFNESS, WIDTH = "stiffness", "loop width"
OPTION = re.compile(r"(?<![\w-])--[a-z]")


@pytest.fixture
def studio(tmp_path: Path) -> Iterator[Any]:
    with studio_of(tmp_path) as found:
        yield found


def said() -> list[str]:
    """Every text of the package that names an option."""
    return [
        node.value
        for path, tree in trees().items()
        if not re.match("hysid/(?!intake/|commands/)", path)
        for node in ast.walk(tree)
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
        and "\n" not in node.value and OPTION.search(node.value)
    ]  # fmt: skip


def test_no_text_of_the_package_names_an_option_on_the_page():
    texts = said()
    assert len(texts) > 50
    for text in texts:
        assert not OPTION.search(on_page(text)), text
        assert on_page(text).strip(), text


@pytest.mark.parametrize(("text", "shown"), [
    ("Name the output (--output COL).", "Name the output (“output”)."),
    ("Give --time COL or --dt SECONDS, not both.", "Give “time” or “Time between samples”, not both."),
    ('Give them: hysid init FILE --input "COL" --output "COL".', "Give them: “input” and “output”."),
    ("Name another one (--out DIR), or use --overwrite.", "Name another one."),
    ("Fit again: hysid fit FILE.", "Fit again: “Fit”."),
    ("--hold needs one column.", "“Creep or relaxation” needs one column."),
    ("A well-known 5--6 case.", "A well-known 5--6 case."),
])  # fmt: skip
def test_controls_stand_in_place_of_options(text, shown):
    assert on_page(text) == shown


@settings(max_examples=10)
@given(st.dictionaries(st.sampled_from(["name", "columns", "command"]), st.text()))
def test_names_are_left_as_they_are(document):
    assert worded(document) == document
    assert worded({"columns": [{"name": "--input"}], "fix": "--input"}) == {
        "columns": [{"name": "--input"}], "fix": "“input”",
    }  # fmt: skip


def kept(studio: Any, fit: identify.FitResult, name: str) -> Path:
    """The folder of a fit in that of a studio."""
    return identify.save(fit, studio.folder.root / name)


def sponge() -> Record:
    t, force, displacement, _ = SpongeRig().five_cycles(noise=0.05, seed=50)
    return Record.from_arrays(force, displacement, t, input_unit="N", output_unit="mm")


def test_sliders_stay_within_bounds(studio):
    model = Burgers(E1=1.0, eta1=2.0, E2=3.0, eta2=4.0)
    fit = replace(identify.fit(sponge(), "LinearSponge", noise="gaussian"), model=model)
    place = kept(studio, fit, "burgers")
    found = studio.fits.curves(place)["sliders"]
    assert {"E1", "eta1", "E2", "eta2"} <= {one["name"] for one in found}
    for one in found:
        assert one["low"] < one["value"] < one["high"]
        for end in (one["low"], one["high"]):
            there = Burgers(**{n: float(getattr(model, n)) for n in NAMES} | {one["name"]: end})
            wanted = np.asarray(there.simulate(fit.train.time, fit.train.input))
            drawn = studio.fits.redrawn(place, {one["name"]: end}, {})["model"]
            np.testing.assert_allclose(drawn, wanted)


def test_sliders_move_the_figures_that_they_name(studio):
    fit = identify.fit(sponge(), "Preisach", conditioning="keep")
    place = kept(studio, fit, "relays")
    known = {one["name"]: one["value"] for one in studio.fits.curves(place)["shapes"]}
    assert {STIFFNESS, WIDTH} <= known.keys()

    def figures(factors: dict[str, float]) -> dict[str, float | None]:
        residuals = studio.fits.redrawn(place, {}, factors)["residual"]
        moved = replace(fit, residuals=residuals)
        return {one.name: one.value for one in moved.characteristics}

    before = figures({})
    assert before == pytest.approx({one.name: one.value for one in fit.characteristics})
    wide, stiff = figures({WIDTH: 2.0}), figures({STIFFNESS: 2.0})
    assert wide[WIDTH] == pytest.approx(2 * before[WIDTH], rel=1e-3)
    assert wide[STIFFNESS] == pytest.approx(before[STIFFNESS], rel=0.1)
    assert stiff[STIFFNESS] == pytest.approx(2 * before[STIFFNESS], rel=0.1)
    assert stiff[WIDTH] == pytest.approx(before[WIDTH], rel=1e-3)
    for wrong in ({"offset": 1.0}, {STIFFNESS: 0.0}, {WIDTH: -1.0}, {WIDTH: 1e300}):
        refuses("unknown-parameter", lambda wrong=wrong: studio.fits.redrawn(place, {}, wrong))
