"""Cycles of one kind tell how a specimen changes; a zero that moves far is told before anything else."""

import numpy as np
import pytest

import hysid
from hysteresis import InputError, Record, read_csv
from hysteresis.internal import check_identifiable
from hysteresis.records._change import change


def cycled(per_cycle: float, cycles: int = 8, noise: float = 0.01) -> Record:
    """A loop of 1 N over 10 mm whose zero moves at a steady rate."""
    t = np.linspace(0, cycles, 60 * cycles + 1)
    u = 5 - 5 * np.cos(2 * np.pi * t)
    y = u + 0.5 * np.sin(2 * np.pi * t) + per_cycle * t
    y += np.random.default_rng(0).normal(0, noise, len(t))
    return Record.from_arrays(u, y, t, input_unit="mm", output_unit="N", output_name="force")


def test_of_four_cycles_chance_seldom_makes_a_rate():
    random, t = np.random.default_rng(1), np.linspace(0, 4, 81)
    u = 5 - 5 * np.cos(2 * np.pi * t)
    found = [change(Record.from_arrays(u, u + random.normal(size=81), t)) for _ in range(400)]
    assert sum(one is not None and one.is_sure for one in found) <= 12  # 4 expected, 3 in a hundred


def test_of_very_many_cycles_some_tell_the_rate():
    u = np.append(np.tile([0.0, 1.0, 2.0, 1.0], 20_000), 0.0)
    found = change(Record.from_arrays(u, u + 1e-4 * np.arange(len(u))))
    assert found.rate == pytest.approx(4e-4)
    assert (found.first, found.last) == (1, 20_000)


def test_a_zero_that_moves_far_is_told_first():
    (first, *_) = check_identifiable(cycled(0.3))
    assert first.code == "zero-moves"
    assert first.values["moved"] == pytest.approx(2.1, rel=0.05)
    assert all(note.code != "zero-moves" for note in check_identifiable(cycled(0.05)))


def test_a_sign_is_turned_and_said(tmp_path):
    record, file = cycled(0.0), tmp_path / "run.csv"
    rows = zip(record.input, record.output, strict=True)
    file.write_text("x,force\n" + "".join(f"{float(u)!r},{float(y)!r}\n" for u, y in rows))
    back = read_csv(file, "x", "force", turn=["force"])
    np.testing.assert_array_equal(back.output, -record.output)
    np.testing.assert_array_equal(back.input, record.input)
    assert "Turned the sign of 'force'." in back.history
    with pytest.raises(InputError, match="'torque' is not used"):
        read_csv(file, "x", "force", turn=["torque"])
    columns = {"x (mm)": record.input, "F (N)": record.output}
    fit = hysid.fit(
        columns, input="x (mm)", output="F (N)", turn="F (N)", model="LinearSponge",
        noise="gaussian", starts=1,
    )  # fmt: skip
    np.testing.assert_array_equal(fit.train.output, -record.output)
