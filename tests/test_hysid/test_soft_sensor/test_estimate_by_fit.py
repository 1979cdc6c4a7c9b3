"""`hysid microchannel estimate` of a plain fit: forces in N with the deviation of held-out rows."""

import csv
from pathlib import Path

import numpy as np
import pytest

import hysid
import identify
from compensate.runtime import load_force
from tests.test_hysid.command import refused, run

NOISE, KGF = 0.05, 9.80665
F = 12 + 10 * np.sin(0.13 * np.arange(400))  # N
Y = 0.3 * F + 0.5 + NOISE * np.random.default_rng(4).normal(size=400)  # V


@pytest.mark.parametrize("turned", [False, True], ids=["force to reading", "reading to force"])
def test_a_fit_is_a_force_sensor(tmp_path: Path, turned: bool):
    columns = {"force (kgf)": F / KGF, "reading (V)": Y, "time (s)": 0.1 * np.arange(400)}
    names = ["force (kgf)", "reading (V)"]
    given, taken = names[::-1] if turned else names
    fit = hysid.fit(
        columns, input=given, output=taken, time="time (s)", model="LinearSponge",
        noise="gaussian", test_tail=0.3, clocks="keep",
    )  # fmt: skip
    folder, file = identify.save(fit, tmp_path / "fit"), tmp_path / "new.csv"
    with file.open("w", newline="") as handle:
        writer = csv.writer(handle)
        writer.writerow(columns)
        writer.writerows(zip(*(x.tolist() for x in columns.values()), strict=True))
    out = ("--runtime", tmp_path / "force.json", "--json")
    found = run("microchannel", "estimate", folder, file, *out).json()
    with open(found["file"]) as handle:
        rows = list(csv.DictReader(handle))
    force = np.array([float(row["force"]) for row in rows])
    deviation = np.array([float(row["force_sd"]) for row in rows])
    # 0.05 V over 0.3 V/N; 400 rows give their rms to 4 %, the held-out 120 to 7.
    assert np.sqrt(np.mean((force - F) ** 2)) == pytest.approx(NOISE / 0.3, rel=0.1)
    assert np.median(deviation) == pytest.approx(NOISE / 0.3, rel=0.2)
    assert found["rmse"] == pytest.approx(np.sqrt(np.mean((force - F) ** 2)), rel=1e-9)
    runtime = load_force(found["runtime"])
    # At the trained ends estimates are held there, and OK while their band reaches back.
    held = (force == force.min()) | (force == force.max())
    inside = [k for k in range(400) if rows[k]["force_status"] == "OK" and not held[k]]
    assert len(inside) > 300
    np.testing.assert_allclose(
        [runtime.step(0.1, Y[k]).value for k in inside], force[inside], rtol=1e-9
    )
    in_mv = tmp_path / "mv.csv"
    in_mv.write_text(file.read_text().replace("reading (V)", "reading (mV)"))
    assert run("microchannel", "estimate", folder, in_mv).code == 2


def test_a_fit_without_a_force_is_refused(tmp_path: Path):
    fit = hysid.fit(F, Y, model="LinearSponge", noise="gaussian", input_unit="mm", output_unit="V")
    done = run(
        "microchannel", "estimate", identify.save(fit, tmp_path / "fit"), tmp_path / "none.csv"
    )
    refused(done, "[wrong-unit]")
