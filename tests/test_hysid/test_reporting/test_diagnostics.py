"""Whether a report says what cannot be believed, and what it shows of fits that can."""

import re
from pathlib import Path

import numpy as np
import pytest

from benchmarks._identification.cases import constructed_cases, shown
from hysteresis import Record
from identify import fit, save
from tests.test_hysid.test_reporting.test_report import write_report
from tests.thorough import rest_thorough

QUESTIONS = (
    "What is the noise?", "Are the residuals white?", "Where is the model wrong?",
    "Is there a better minimum?", "How precisely is each parameter known?",
    "Which combinations of parameters are known?",
    "Do new readings lie inside the predictive bands?", "Which rows does the fit depend on?",
)  # fmt: skip


@pytest.mark.parametrize(
    "case",
    rest_thorough(constructed_cases(), lambda case: case.name == "at bound"),
    ids=lambda case: case.name,
)
def test_what_cannot_be_believed_is_shown_everywhere(case, tmp_path: Path) -> None:
    assert all(shown(case, tmp_path))


def questions(file: Path) -> list[str]:
    return re.findall(r"<h3 id=\"[a-z-]+\">([^<]+)</h3>", file.read_text("utf-8"))


@pytest.mark.thorough
def test_a_fit_by_weights_is_asked_what_makes_sense(tmp_path: Path) -> None:
    u = np.concatenate([np.linspace(0, 1, 40), np.linspace(1, 0, 40)] * 4)
    y = u + u**3 + 0.01 * np.random.default_rng(0).normal(size=len(u))
    found = fit(Record.from_arrays(u, y, output_unit="N"), "Composition", test_cycles=1)
    file = write_report(save(found, tmp_path))
    assert questions(file) == [QUESTIONS[k] for k in (0, 1, 2, 3, 6)]
    assert "A sum of a rising curve" in file.read_text("utf-8")
