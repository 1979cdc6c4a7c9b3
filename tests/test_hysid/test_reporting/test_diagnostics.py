"""Whether a report says what cannot be believed, and what it shows of fits that can."""

from pathlib import Path

import pytest

from benchmarks._identification.cases import constructed_cases, shown
from tests.thorough import rest_thorough


@pytest.mark.parametrize(
    "case",
    rest_thorough(constructed_cases(), lambda case: case.name == "at bound"),
    ids=lambda case: case.name,
)
def test_what_cannot_be_believed_is_shown_everywhere(case, tmp_path: Path) -> None:
    assert all(shown(case, tmp_path))
