"""Variants of what rig makers export: each is read right, and never wrong in silence."""

import pytest

from benchmarks._vendor_files._judge import outcome, variants

FILES = variants()
REFUSED = {"thousands with points, German": "thousands-separator"}
"""Variants that are refused, which says what to do, and not read."""


@pytest.mark.parametrize("name", FILES)
def test_a_variant_is_read_right(name, tmp_path):
    pytest.importorskip("python_calamine", reason="python-calamine is an extra")
    file = tmp_path / f"run{FILES[name].suffix}"
    FILES[name].write(file)
    word, why = outcome(file, FILES[name])
    if name in REFUSED:
        assert (word, REFUSED[name] in why) == ("refused", True), why
    else:
        assert word == "right", why
