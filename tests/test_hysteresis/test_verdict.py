"""Verdicts add up in one way: the worst level counts, and all reasons stay."""

import ast
import json
from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st

from hysteresis import Note
from identify.internal import Verdict

LEVELS = ("PASS", "CAUTION", "FAIL")
levels = st.sampled_from(LEVELS)


@given(levels, levels, st.lists(st.text(), max_size=3))
def test_a_demoted_verdict_keeps_its_reasons(level, most, reasons):
    before = Verdict(level, ("The error is 1 %.",))
    after = before.at_most(most, *reasons)
    assert after.level == max(level, most, key=LEVELS.index)
    assert after.reasons == ("The error is 1 %.", *reasons)


@given(levels, st.lists(st.tuples(st.text(), st.text()), max_size=3), st.text())
def test_a_verdict_comes_back_from_its_document(level, said, best):
    before = Verdict(level, tuple(Note(code, text) for code, text in said), best)
    after = Verdict.of(json.loads(json.dumps(before.document)))
    assert after == before
    assert after.codes == before.codes == tuple(code for code, _ in said)


SAYING = (
    "identify/fitting", "identify/diagnostics", "compensate", "hysid/commands",
)  # fmt: skip
"""Folders whose files write the sentences of verdicts."""

ALIKE = {"other-class", "rows-seen"}
"""Without a figure of their own: the words of a candidate's note, and rows that the fit has seen."""


def test_every_sentence_of_a_verdict_has_a_test_that_names_its_code():
    root = Path(__file__).resolve().parents[2]
    tests = "".join(file.read_text() for file in (root / "tests").rglob("test_*.py"))
    codes = {
        call.args[0].value
        for folder in SAYING
        for file in (root / folder).glob("*.py")
        for call in ast.walk(ast.parse(file.read_text()))
        if isinstance(call, ast.Call) and getattr(call.func, "id", "") in ("Note", "warning")
        and isinstance(call.args[0], ast.Constant)
    }  # fmt: skip
    assert {"error", "baseline-better", "open-range", "above-max-error"} <= codes
    assert {code for code in codes - ALIKE if f'"{code}"' not in tests} == set()
