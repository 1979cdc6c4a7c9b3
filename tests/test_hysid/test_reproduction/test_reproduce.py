"""`hysid reproduce`: what it writes, what it compares, and that it does so honestly."""

import json
from types import NoneType
from typing import Any

import numpy as np
import pytest

from hysid.reproduction._armor import Change, changed, linear_range
from hysid.reproduction._frame import Published
from hysteresis.rigs import SpongeRig
from tests.test_hysid.command import Result, refused, run, tree
from tests.test_hysid.test_cli.test_cli import fits

ROW = {"key": str, "what": str, "where": str, "unit": str, "published": float, "reproduced": float}
ROW |= {"sd": float, "ours": float | NoneType, "label": str, "differs": str}
FINDING = {"published": str, "reproduced": str}
SEED = 100
"""Of rigs that the command's own run does not use."""


@pytest.fixture(scope="module")
def made(tmp_path_factory) -> tuple[Result, object]:
    out = tmp_path_factory.mktemp("reproduced") / "out"
    asked = ("--rigs", 4, "--seed", SEED, "--no-ours", "--json")
    return run("reproduce", "tsuji2014", "--out", out, *asked), out


@pytest.mark.thorough
def test_one_object_on_stdout_and_the_same_in_the_folder(made):
    result, out = made
    document = result.json()
    assert json.loads((out / "reproduction.json").read_text()) == document
    assert all(fits(row, ROW) and isinstance(row["within"], bool) for row in document["rows"])
    assert all(fits(finding, FINDING) for finding in document["findings"])
    assert "4 of 4" in result.err
    assert set(tree(out)) == {"reproduction.json", *document["files"].values()}
    table = (out / "table.txt").read_text()
    for row in document["rows"]:
        line = next(line for line in table.splitlines() if line.startswith(f"{row['what']}  "))
        assert row["label"] in ("tuned to this number", "inferred", "predicted")
        assert all(row[name] in line for name in ("where", "label", "differs"))


@pytest.mark.thorough
def test_the_papers_numbers_are_those_of_the_paper(made):
    """Each number as the paper prints it, and none that it does not print."""
    rows = {row["key"]: row for row in made[0].json()["rows"]}
    paper = {
        "mean_gap": 3.93, "largest_gap": 5.67, "largest_gap_force": 8.0, "largest_gap_test": 1.0,
        "linear_limit": 25.0, "aged_K": 1.298, "aged_b": 6.186, "error_1": 1.7, "error_2": 3.3,
        "error_3": 4.7, "error_largest": 10.0, "body_a": 27.2, "body_b": 16.3, "body_c": 13.2,
    }  # fmt: skip
    assert {key: row["published"] for key, row in rows.items()} == paper
    # What does not hang on the sensor is known from four rigs already.
    for key, off in {"mean_gap": 0.05, "linear_limit": 1.5, "error_2": 0.4, "error_3": 0.4}.items():
        assert abs(rows[key]["reproduced"] - paper[key]) < off, rows[key]
    assert rows["error_largest"]["within"]


def test_results_are_not_written_over(tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    (out / "reproduction.json").write_text("{}")
    before = tree(out)
    again = run("reproduce", "tsuji2014", "--out", out, "--rigs", 2)
    refused(again, "[would-overwrite]", "--overwrite")
    assert tree(out) == before
    (tmp_path / "file").write_text("")
    refused(run("reproduce", "tsuji2014", "--out", tmp_path / "file", "--rigs", 2), "is a file")
    refused(run("reproduce", "tsuji1914"), "tsuji2014")


def test_a_worse_rig_does_not_pass_more_easily():
    """The tolerance is the paper's: of its digits, or of its own trials; the rigs' scatter is not in it."""

    def row(published: float, found: list[float], **others: Any) -> dict:
        words = ("k", "k", "II", "mm", "predicted", "?")
        return Published(*words, lambda rig, _: 0, published, 0.5, **others).row(found)

    assert row(10.4, [9.9, 10.1])["within"]
    assert not row(10.6, [9.9, 10.1])["within"]
    assert not row(10.6, [0.0, 20.0])["within"]
    assert row(30.0, [0.0, 20.0], at_most=True)["within"]
    assert not row(9.4, [9.9, 10.1], at_most=True)["within"]
    # Clopper and Pearson: (alpha/2)^(1/n) for n of n, and of 18 of 20 as published tables have it.
    assert row(20.0, [17.0], repeats=20)["tolerance"] == pytest.approx([20 * 0.025**0.05, 20])
    of_18 = row(18.0, [14.0], repeats=20)["tolerance"]
    assert of_18 == pytest.approx([20 * 0.6830, 20 * 0.9877], abs=2e-3)
    low, high = row(93.0, [90.0], repeats=100, percent=True)["tolerance"]
    assert (low, high) == pytest.approx((86.11, 97.14), abs=0.01)


def test_aging_is_seen_where_there_is_any():
    """No change between two readings of one sponge, a change of 1 % in another's stiffness."""
    one = SpongeRig().five_cycles(noise=0.05, seed=SEED)
    again = SpongeRig().five_cycles(noise=0.05, seed=SEED + 1)
    soft = SpongeRig(stiffness_n_per_mm=0.6503 * 0.99).five_cycles(noise=0.05, seed=SEED + 1)
    assert changed(one, again).p > 0.05
    found: Change = changed(one, soft)
    assert found.p < 1e-6
    assert found.K / found.K_error > 3


def test_linear_range_ends_where_a_kink_is():
    """A line to 30 N and a plateau beyond: the mean leaves it by its bar soon after."""
    force = np.tile([*np.arange(0.0, 41, 2), *np.arange(38.0, -1, -2)], 3)
    side = np.repeat([-1.0, 0.0, 1.0], len(force) // 3)  # of three cycles, 0.5 mm apart
    line = force + 0.5 * side
    made, cycle = type(SpongeRig().five_cycles()), np.ones(len(force), int)
    straight = made(6.0 * np.arange(len(force)), force, line, cycle)
    assert linear_range(straight) == 40
    bent = straight._replace(displacement=np.minimum(force, 30.0) + 0.5 * side)
    assert 30 < linear_range(bent) < 31
