"""The page on many specimens: complete, self-contained, and right about who stands out."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

import identify
from hysteresis import LinearSponge, Record
from tests.test_hysid.command import refused, run
from tests.test_hysid.test_reporting.test_report import Page

SLOPES = (2.0, 2.05, 1.95, 2.1, 1.9, 3.5)
NAMES = ("pad-1", "pad-2", "pad-3", "pad-9", "pad-10", "odd <one>")


@pytest.fixture(scope="module")
def batch(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Six fits of lines, one far steeper, a record that could not be fitted; reports of all but one."""
    folder = tmp_path_factory.mktemp("rig") / "batch"
    u = np.tile(np.r_[0:20, 20:0:-1], 4) / 2.0
    records = [
        Record.from_arrays(
            u, k * u + 0.05 * np.random.default_rng(i).normal(size=len(u)),
            input_name="force (N)", output_name="displacement (mm)", input_unit="N",
            output_unit="mm",
        )
        for i, k in enumerate(SLOPES)
    ]  # fmt: skip
    line, how = LinearSponge(1.0, 0.0, -np.inf), {"noise": "gaussian", "starts": 2}
    identify.fit_many(records, line, out=folder, names=NAMES, **how)
    state = json.loads((folder / "batch.json").read_text("utf-8"))
    state["failed"] = {"bad": "nothing in it. [no-rows]"}
    (folder / "batch.json").write_text(json.dumps(state))
    for name in NAMES[:-1]:  # to write one takes three seconds
        (folder / name / "report.html").touch()
    return folder


@pytest.fixture(scope="module")
def found(batch: Path) -> dict:
    return run("report", batch, "--json").json()


def test_the_folder_of_a_batch_is_its_fits_in_natural_order(found: dict):
    assert [one["name"] for one in found["specimens"]] == [
        "odd <one>", "pad-1", "pad-2", "pad-3", "pad-9", "pad-10",
    ]  # fmt: skip


def test_the_page_stands_alone_and_leads_to_each_report(batch: Path, found: dict):
    page = Page(batch / "report.html")
    assert Path(found["file"]) == batch / "report.html"
    assert not page.all("script")
    assert "://" not in page.html
    assert "url(" not in page.html
    links = [a["href"] for a in page.all("a")]
    assert links.count("pad-1/report.html") == 1
    of_last = (batch / NAMES[-1] / "report.html").read_text("utf-8")
    assert " (odd &lt;one&gt;)</title>" in of_last  # which tells it from the others
    ids = {attributes["id"] for _, attributes in page.tags if "id" in attributes}
    assert {link[1:] for link in links if link.startswith("#")} <= ids
    assert "Loops of the specimens" in page.html
    assert all(a["alt"].strip() for a in page.all("img"))
    regions = [a["aria-label"] for _, a in page.tags if a.get("role") == "region"]
    assert len(set(regions)) == len(regions)
    assert not page.all("one")
    assert "bad is not in the table: nothing in it." in page.text
    assert len(page.html) / len(SLOPES) < 50_000


def test_it_names_the_one_that_stands_out(batch: Path, found: dict):
    assert list(found["outliers"]) == ["odd <one>"]
    assert "K above the others" in found["outliers"]["odd <one>"]
    assert found["outliers"]["odd <one>"] in Page(batch / "report.html").text


def test_mean_and_scatter_are_those_of_the_pool(found: dict):
    mean = next(p for p in found["population"] if p["name"] == "K")
    assert mean["mean"]["low"] < np.exp(np.mean(np.log(SLOPES))) < mean["mean"]["high"]
    assert mean["new"]["high"] - mean["new"]["low"] > mean["mean"]["high"] - mean["mean"]["low"]
    for one, slope in zip(sorted(found["specimens"], key=lambda s: NAMES.index(s["name"])), SLOPES,
                          strict=True):  # fmt: skip
        parameter = next(p for p in one["parameters"] if p["name"] == "K")
        assert parameter["low"] < parameter["value"] < parameter["high"]
        assert parameter["value"] == pytest.approx(slope, abs=0.05)


def test_a_damaged_fit_is_named_and_stops_nothing(batch: Path, tmp_path: Path):
    folder = shutil.copytree(batch, tmp_path / "copy")
    (folder / "pad-2" / "fit.json").write_text("{}")
    found = run("report", folder, "--json").json()
    assert len(found["specimens"]) == 5
    assert "pad-2" in found["failed"]


def test_the_command_takes_folders_and_folders_of_folders(batch: Path, tmp_path: Path):
    for k in (1, 2):
        shutil.copytree(batch / f"pad-{k}", tmp_path / f"pad-{k}")
        (tmp_path / f"pad-{k}" / "report.html").touch()
    two = run("report", tmp_path / "pad-1", tmp_path / "pad-2", tmp_path / "pad-1", "--json").json()
    assert Path(two["file"]) == tmp_path / "specimens.html"
    assert [s["name"] for s in two["specimens"]] == ["pad-1", "pad-2"]
    assert two["outliers"] == {}
    assert "Fewer than 5 specimens" in Page(Path(two["file"])).text
    below = run("report", tmp_path, "--json").json()
    assert Path(below["file"]) == tmp_path / "report.html"
    assert below["specimens"] == two["specimens"]
    (tmp_path / "pad-2").rename(tmp_path / ("pad-2" * 20))  # which leaves room for its figures
    page = Path(run("report", tmp_path, "--json").json()["file"]).read_text("utf-8")
    assert page.count('<th scope="row" class="long">') == 2  # of both tables
    empty = tmp_path / "empty"
    empty.mkdir()
    refused(run("report", empty), "file-not-found")
