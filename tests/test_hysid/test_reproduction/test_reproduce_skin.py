"""`hysid reproduce kim2018`: what it measures, on skins that learn little, and how it counts peaks."""

from functools import cached_property

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from compensate.internal import SearchEstimator
from hysid.reproduction import reproduce, terminal
from hysid.reproduction._skin import converted
from hysid.reproduction._skin_paper import DT, PAIR, SkinPair, peaks
from hysteresis.internal import ResistiveReadout

SEED = 300
"""Of sensors that the command's own run does not use."""

PRINTED = {
    "mse_start": 20.07, "mse_end": 0.003, "training": 331.0,
    "right_A": 20, "right_B": 18, "right_C": 20, "right_D": 15, "right_E": 20, "accuracy": 93.0,
    "b_for_c": 2, "d_for_e": 5, "logic": 21, "peaks": 16,
}  # fmt: skip


class Line(eqx.Module):
    """A location that knows no history: readings in proportion to the force."""

    slope: jnp.ndarray

    def __call__(self, windows):
        return windows[:, -1:] * self.slope[None]


class LinePair(SkinPair):
    """The search through lines in the place of recurrent networks."""

    @cached_property
    def paper(self) -> SearchEstimator:
        slopes = self.rig.readout.scale * self.rig.gains[:, PAIR]
        return SearchEstimator([Line(jnp.asarray(slope)) for slope in slopes.T])


@pytest.fixture(scope="module")
def document(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("hysid.reproduction._skin.SESSIONS", 2)
        patch.setattr("hysid.reproduction._skin_paper.SkinPair", LinePair)
        patch.setattr("hysid.reproduction._skin_paper.PAIRS", 1)
        out, said = tmp_path_factory.mktemp("skin"), []
        made = reproduce("kim2018", out, rigs=2, seed=SEED, ours=False, epochs=1, say=said.append)
    assert any("2 of 2" in line for line in said)
    return made, out


@pytest.mark.thorough
def test_every_printed_number_has_a_row(document):
    made, out = document
    rows = {row["key"]: row for row in made["rows"]}
    printed = {key: row["published"] for key, row in rows.items() if row["published"] is not None}
    assert printed == PRINTED
    for row in rows.values():
        assert (row["published"] is None) == (row["label"] == "not printed")
    assert all(
        (row["published"] is None or key == "training")
        == (row["within"] is None)
        == (row["tolerance"] is None)
        for key, row in rows.items()
    )
    assert {row["count"] for row in rows.values()} == {1, 2}  # two contacts on the first alone
    each = [rows[f"right_{place}"]["reproduced"] for place in "ABCDE"]
    assert rows["accuracy"]["reproduced"] == pytest.approx(sum(each))
    for name in made["files"].values():
        assert (out / name).stat().st_size > 0
    table = (out / "table.txt").read_text()
    assert all(f"Table {n}" in table for n in ("I", "II"))
    assert any("kim" in line or "Table II" in line for line in terminal(made))


@pytest.mark.thorough
def test_the_search_follows_a_machine_through_lines(document):
    """Lines know neither closing nor friction; they still see most of a machine's presses."""
    rows = {row["key"]: row for row in document[0]["rows"]}
    assert rows["peaks_placed"]["reproduced"] >= 14
    assert rows["placed"]["reproduced"] < 1.6


def test_a_peak_is_found_once_and_told_how_late():
    """One late by two readings, one too low to count, one not seen."""
    t = np.arange(200)
    bump = np.maximum(0.0, 1 - np.abs(t - 60) / 20)
    later = np.maximum(0.0, 1 - np.abs(t - 150) / 20)
    truth = np.stack([4 * bump + 4 * later, 4 * bump], 1)
    found = np.stack([np.roll(4 * bump, 2) + 1.5 * later, 0 * bump], 1)
    first, second, third = peaks(truth, found)
    assert (first.location, first.force, first.found) == ("B", 4.0, 4.0)
    assert (first.late, first.time) == pytest.approx((2 * DT, 61 * DT))
    assert np.isnan([second.found, third.found]).all()  # 1.5 is not half of 4, and D sees nothing


def test_the_electronics_give_back_what_the_sensor_said():
    """Half a step of the converter at most, and the factor of a current that is taken for another."""
    usual, weak = ResistiveReadout(), ResistiveReadout(current_a=0.070)
    change = np.linspace(0, 1.5, 400)[:, None] * [1.0, 0.5]
    step = 20.5 / 1023
    for electronics in (usual, weak):
        back = converted(electronics.scale * change, electronics)
        half = step / 2 * usual.scale / electronics.scale
        assert np.abs(back - usual.scale * change).max() <= half * (1 + 1e-9)
    taken = converted(weak.scale * change, weak, current=usual.current_a)
    assert np.abs(taken - weak.scale * change).max() <= step / 2 * (1 + 1e-9)
