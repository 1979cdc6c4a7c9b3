"""`hysid armor view`: a page that needs nothing else, and holds the record it was made from."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
import scipy.stats

from compensate.armor import Box, ContactSolver
from hysid.armor._touches import read_touches, save_touches, shell_of
from hysteresis import LinearSponge
from hysteresis.internal import force_path
from hysteresis.rigs import ArmorRig
from tests.test_hysid.command import refused, run
from tests.test_hysid.test_reporting.test_report import Page

TITLE = 'Presses </script> & "quotes"'
COVARIANCE = np.diag([4e-6, 1e-6, 0.0])


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Two presses, with rows before the threshold and after."""
    rig = ArmorRig(seed=100)
    points, surface = rig.random_points(2)
    made = rig.press(points, surface, force_path((0.0, 15.0, 0.0), 2.5))
    F, M = np.split(made.wrench.reshape(-1, 6), 2, axis=1)
    solver = ContactSolver(Box(*rig.size), LinearSponge(K=1.3, b=6.2, threshold=1.5))
    save_touches(
        tmp_path, shell_of(solver.shape), np.arange(len(F)) / 10, F, M, solver.solve(F, M),
        title=TITLE, covariance=np.tile(COVARIANCE, (len(F), 1, 1)),
    )  # fmt: skip
    return tmp_path


def held(page: str) -> dict:
    """The record inside the page."""
    found = re.search(r'<script id="record" type="application/json">(.*?)</script>', page, re.S)
    return json.loads(found[1])


def test_page_holds_its_record_and_needs_nothing_else(folder):
    result = run("armor", "view", folder, "--json").json()
    assert result == {"file": str(folder / "armor.html"), "rows": 24}
    page = Page(folder / "armor.html")
    record, kept = held(page.html), read_touches(folder)
    for name in ("time", "force", "point", "status", "triangles", "title"):
        assert record[name] == kept[name]
    assert "covariance" not in record
    assert not re.search(r"https?:|url\(|@import|fetch\(|XMLHttpRequest", page.html)
    assert not any("src" in attributes or "href" in attributes for _, attributes in page.tags)
    assert {"OK", "BELOW_THRESHOLD"} <= set(record["status"])
    assert set(record["status"]) <= set(record["meanings"])


def test_half_axes_hold_ninety_per_cent(folder):
    """Longest first, sqrt(chi2) of the standard deviations, along the covariance's own directions."""
    assert run("armor", "view", folder).code == 0
    record = held((folder / "armor.html").read_text("utf-8"))
    reach = np.sqrt(scipy.stats.chi2.ppf(0.9, 3))
    axes = np.abs(record["axes"][0])
    np.testing.assert_allclose(axes, np.diag(reach * np.array([2e-3, 1e-3, 0])), atol=1e-7)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda d: d.update(schema=2), "schema"),
        (lambda d: d.pop("force"), "force"),
        (lambda d: d.update(time=[]), "rows"),
        (lambda d: d.update(time=d["time"][::-1]), "time"),
        (lambda d: d["status"].pop(), "status"),
        (lambda d: d.update(triangles=[[0, 1, 99]]), "corner"),
        (lambda d: d.update(moment=[[1, 2]] * len(d["time"])), "moment"),
        (lambda d: d.update(surface=["<b>"] * len(d["time"])), "surface"),
        (lambda d: d.update(extra="<script>"), "extra"),
    ],
)
def test_damaged_records_are_refused(folder, change, words):
    file = folder / "touches.json"
    document = json.loads(file.read_text())
    change(document)
    file.write_text(json.dumps(document))
    refused(run("armor", "view", folder), words, "[damaged-file]")
    assert not (folder / "armor.html").exists()


def test_no_record_is_said(tmp_path):
    refused(run("armor", "view", tmp_path), "[file-not-found]", "touches.json")
    (tmp_path / "touches.json").write_text("{")
    refused(run("armor", "view", tmp_path), "[damaged-file]")
