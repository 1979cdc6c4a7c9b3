"""`hysid fit A.csv B.csv --share NAME`, `hysid fit FILE --sigma COL`, and `hysid compare`."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import identify
from tests.test_hysid.command import refused, run
from tests.test_identify.lines import line, pressed

COLUMNS = ("--input", "u (N)", "--output", "y (mm)", "--time", "t (s)")


def written(path, slope: float, sigma: float = 0.05) -> None:
    """Two cycles of a line, as the first specimen or another one would answer."""
    u = np.tile(np.concatenate([np.linspace(0, 2, 20), np.linspace(2, 0, 20)]), 2)
    each = np.where(np.arange(u.size) % 2, sigma, 20 * sigma)
    y = 0.5 + slope * u + each * np.random.default_rng(int(10 * slope)).normal(size=u.size)
    table = np.column_stack([np.arange(u.size) / 10, u, y, each])
    np.savetxt(path, table, delimiter=",", header="t (s),u (N),y (mm),s", comments="")


def test_specimens_of_several_files_share_a_parameter(tmp_path):
    files = [tmp_path / "a.csv", tmp_path / "b.csv"]
    for file, slope in zip(files, (1.0, 1.1), strict=True):
        written(file, slope)
    how = (*COLUMNS, "--model", "LinearSponge", "--starts", "2", "--out", tmp_path / "both")
    document = run("fit", *files, *how, "--share", "K", "--json").json()
    assert sorted(document["each"]) == ["a", "b"]
    fits = [identify.load(tmp_path / "both" / name) for name in ("a", "b")]
    assert fits[0]["K"].value == fits[1]["K"].value
    assert fits[0]["b"].value != fits[1]["b"].value
    lines = [file.read_text().splitlines() for file in files]
    whole = [f"{line},{k}" for k, rows in enumerate(lines) for line in rows[1:]]
    one = tmp_path / "one.csv"
    one.write_text("\n".join([f"{lines[0][0]},n", *whole]))
    each = run("fit", one, *how[:-2], "--share", "K", "--each", "n", "--json").json()
    found = [fit["parameters"][0]["value"] for fit in each["each"].values()]
    assert found == pytest.approx([fits[0]["K"].value] * 2, rel=1e-6)
    assert "DIR/NAME" in run("predict", tmp_path / "both", files[0]).err
    again = (*how, "--overwrite", "--json")
    assert "conflicting-options" in run("fit", *files, *again).err
    assert "bad-option" in run("fit", *files, *again, "--share", "E1").err
    assert "bad-option" in run("fit", *files, *again, "--share", "K", "--noise", "ar1").err


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Two models of a new sponge, and one of the same sponge after six months."""
    place = tmp_path_factory.mktemp("compare")
    new = pressed(1.2, 5.4, seed=0)
    identify.save(line(*new), place / "new")
    identify.save(line(*new, slope=1.1), place / "too soft")
    free, soft = line(*new), replace(line(*new, slope=1.1), name="too soft")
    identify.save(replace(free, candidates=(free, soft)), place / "both")
    identify.save(line(*pressed(1.298, 6.186, seed=2)), place / "aged")
    return place


def test_models_of_the_same_data_are_ranked(folder):
    said = run("compare", folder / "too soft", folder / "new")
    assert (said.code, said.err) == (0, "")
    lines = said.out.splitlines()
    assert lines[0] == "Ranked by held-out blocks: error in per cent of the output's range."
    assert " ".join(lines[2].split()) == "model held-out test parameters AIC BIC log evidence"
    assert lines[3].split()[:2] == ["1", "new"]
    assert lines[4].startswith("2  too soft")
    # The best of each criterion is the origin of its column.
    assert lines[3].split()[-3:] == ["0"] * 3
    assert "new predicts held-out rows better than too soft by" in said.out
    assert "Note: The evidence weighs the priors too" in said.out


def test_scripts_get_the_same_figures(folder):
    found = run("compare", folder / "too soft", folder / "new", "--json").json()
    assert found["best"] == "new"
    assert [m["name"] for m in found["models"]] == ["new", "too soft"]
    (pair,) = found["pairs"]
    assert (pair["one"], pair["other"]) == ("new", "too soft")
    for rows in ("held_out", "test"):
        assert set(pair[rows]) == {"value", "error", "blocks", "clear"}
        key = f"{rows}_percent"
        first, second = (m[key] for m in found["models"])
        assert second - first == pytest.approx(pair[rows]["value"], rel=0.1)
    assert isinstance(found["notes"], list)


def test_one_folder_compares_its_candidates(folder):
    found = run("compare", folder / "both", "--json").json()
    assert found["best"] == "LinearSponge"
    assert found["pairs"][0]["held_out"]["clear"]
    assert found["pairs"][0]["test"] is None
    said = run("compare", folder / "both").out
    assert "Note: Of candidates the figures alone are kept" in said
    assert "log evidence" not in said


def test_the_fits_of_each_value_are_folders(folder, tmp_path):
    names = {name: name for name in ("new", "aged")}
    for name in names:
        shutil.copytree(folder / name, tmp_path / name)
    (tmp_path / "fit.json").write_text(json.dumps({"schema": 1, "folders": names}))
    assert run("compare", tmp_path, "--change").out.startswith("new -> aged\n")


def test_a_change_is_told_parameter_by_parameter(folder):
    said = run("compare", folder / "new", folder / "aged", "--change")
    lines = said.out.splitlines()
    assert lines[0] == "new -> aged"
    assert lines[2].split() == ["parameter", "unit", "before", "after", "difference", "p"]
    assert lines[3].split()[:2] == ["K", "mm/N"]
    assert lines[3].endswith("< 0.0001")
    assert "The specimen has changed: p < " in said.out
    assert lines[-1] == "Not tested: threshold (fixed)."
    found = run("compare", folder / "new", folder / "aged", "--change", "--json").json()
    assert found["models"] == ["new", "aged"]
    K, b = found["parameters"]
    assert K["difference"] == pytest.approx(0.098, abs=4 * K["error"])
    assert b["clear"]
    assert found["margin"] == 0.05
    assert found["p"] < 1e-4
    wide = run("compare", folder / "new", folder / "aged", "--change", "--margin", 0.5, "--json")
    assert wide.json()["parameters"][0]["changed"] < 0.01


@pytest.mark.parametrize(("names", "options", "words"), [
    (("new", "aged"), (), ("errors do not compare", "--change", "[not-comparable]")),
    (("new", "new"), (), ("named twice",)),
    (("new",), (), ("too-few-fits",)),
    (("new",), ("--change",), ("between two fits; new is given", "[too-few-fits]")),
    (("new", "aged", "both"), ("--change",), ("new, aged, both are given", "[bad-option]")),
    (("new", "too soft"), ("--change",), ("same rows", "[given-twice]")),
    (("new", "nowhere"), (), ("there is no fit.json", "[file-not-found]")),
])  # fmt: skip
def test_what_cannot_be_compared_is_said_in_a_line(folder, names, options, words):
    refused(run("compare", *(folder / name for name in names), *options), *words)
