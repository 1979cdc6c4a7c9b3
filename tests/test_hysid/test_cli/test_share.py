"""`hysid fit A.csv B.csv --share NAME`, and `hysid fit FILE --sigma COL`."""

import numpy as np
import pytest

import identify
from tests.test_hysid.command import run

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
    predicted = run("predict", tmp_path / "both", files[0])
    assert "DIR/NAME" in predicted.err
    again = (*how, "--overwrite", "--json")
    assert "conflicting-options" in run("fit", *files, *again).err
    assert "bad-option" in run("fit", *files, *again, "--share", "E1").err
    assert "bad-option" in run("fit", *files, *again, "--share", "K", "--noise", "ar1").err
