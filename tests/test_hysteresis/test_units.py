"""Units: what conversions are, what models carry of them, and the grammar by which they are read."""

import contextlib
import itertools
from pathlib import Path
from time import perf_counter

import numpy as np
import pint
import pytest
from hypothesis import given
from hypothesis import strategies as st

import identify
from compensate import Quantity, export_runtime, invert
from compensate.internal import BackwardsModel, ForceEstimator
from compensate.microchannel import export_force
from compensate.runtime import load
from hysteresis import Burgers, InputError, LinearSponge, load_model, read_csv, save_model
from hysteresis.internal import Units, conversion, extended, with_units
from tests.refusals import raises, refuses

USUAL = [
    "1", "percent", "N", "mN", "uN", "kN", "gf", "kgf", "lbf", "m", "cm", "mm", "um", "nm", "inch",
    "s", "ms", "us", "min", "h", "V", "kV", "mV", "uV", "A", "mA", "uA", "Pa", "kPa", "MPa", "GPa",
    "ohm", "kohm", "Mohm",
]  # fmt: skip
SENSOR = LinearSponge(0.5, 0.2, units=("kgf", "V"), trained=(0.0, 2.0))  # V behind kgf


@pytest.mark.parametrize(("unit", "wanted", "factor"), [
    ("kgf", "N", 9.80665), ("lbf", "N", 4.4482216152605), ("inch", "m", 0.0254),
    ("min", "s", 60.0),
])  # fmt: skip
def test_conversions_are_those_of_the_standards(unit: str, wanted: str, factor: float):
    assert conversion(unit, wanted) == pytest.approx(factor, rel=1e-13)
    assert conversion(wanted, unit) == pytest.approx(1 / factor, rel=1e-13)


def test_what_is_known_of_usual_units_is_what_pint_says():
    registry = pint.get_application_registry()
    for unit, wanted in itertools.product(USUAL, repeat=2):
        known, said = conversion(unit, wanted), registry.Quantity(1.0, unit)
        assert (known is not None) == said.is_compatible_with(wanted)
        if known is not None:
            assert known == pytest.approx(said.to(wanted).magnitude, rel=1e-14)


@pytest.mark.parametrize(
    ("unit", "wanted"), [("mm", "N"), ("1", "N"), ("degC", "K"), ("a.u.", "N")]
)
def test_what_is_no_multiple_is_not_converted(unit: str, wanted: str):
    assert conversion(unit, wanted) is None


def test_models_carry_units_and_range_through_files(tmp_path):
    model = Burgers(1.0, 2.0, 3.0, 4.0, units=("N", "mm", "min"), trained=(0, 20))
    again = load_model(save_model(model, tmp_path / "it.json"))
    assert again.units == Units("N", "mm", "min")
    assert np.asarray(again.trained).tolist() == [0.0, 20.0]
    assert extended(model, -1.0, 30.0).units == model.units
    assert invert(model).units == Units("mm", "N", "min")
    assert invert(model, trained=(0.0, 20.0)).units == Units("mm", "N", "min")
    refuses("zero-range", lambda: with_units(model, None, (3.0, 1.0)))


def test_forces_are_converted_to_newtons_or_refused(tmp_path):
    backwards = BackwardsModel(invert(SENSOR))
    estimator = ForceEstimator(backwards, deviation=0.1, high=25.0)
    y = np.linspace(0.2, 1.2, 20)
    found = estimator.simulate(None, y).value
    np.testing.assert_allclose(found, 9.80665 * (y - 0.2) / 0.5, rtol=1e-12, atol=1e-12)
    runtime = load(export_force(estimator, tmp_path / "force.json", y))
    assert runtime.step(0.01, 0.7).value == pytest.approx(9.80665, rel=1e-12)
    refuses("wrong-direction", lambda: ForceEstimator(SENSOR, deviation=0.1, high=25.0))
    with pytest.raises(InputError, match="wrong-unit"):
        ForceEstimator(with_units(SENSOR, Units("V", "mm")), deviation=0.1, high=25.0)


def test_exports_name_the_units_that_a_model_carries(tmp_path):
    y = np.linspace(0.2, 1.2, 20)
    text = export_runtime(SENSOR, tmp_path / "it.json", y).path.read_text()
    assert '"kgf"' in text
    assert '"V"' in text
    with pytest.raises(InputError, match="wrong-unit"):
        export_runtime(SENSOR, tmp_path / "it.json", y, estimate=Quantity("force", "N"))


UNITS = (
    "N/mm", "mm**2", "kg*m/s^2", "N·mm", "m s^-1", "1/s", "mm^1.5", "N**0.5", "(N/mm)/s", "µm/m",
    "V/(mm*N)", "degC", "m²", "mm**(1/2)", "mm**-1", "°", "N per mm",
    "kilogram * meter / second ** 2", "%", "kN.m",
)  # fmt: skip
SPELLED = {"kN.m": "kN*m", "°": "deg", "%": "percent", "m s^-1": "m s^-1"}
"""Those that a record calls otherwise."""
BOMBS = (
    "10**10**10", "9^9^9", "m**99", "m**1e9", "m**2.5e3", "m**9**9", "(10**9)**9", "2*m",
    "(" * 99 + "m" + ")" * 99, "m" * 99, "m*" * 40 + "m", "__import__('os')", "lambda: m", "m[0]", "m.real",
    "-m", "m**-", "m*",
    "*m", "()", "m)", "(m", "1e9 m", "", " ",
)  # fmt: skip


def unit_of(folder: Path, unit: str) -> str:
    """Of a record whose output is said to be in it."""
    (folder / "run.csv").write_text("x,y\n1,2\n2,3\n3,4\n")
    return read_csv(folder / "run.csv", "x", "y", output_unit=unit).output_unit


@pytest.mark.parametrize("unit", UNITS)
def test_units_are_within_the_grammar(unit: str, tmp_path: Path):
    assert unit_of(tmp_path, unit) == SPELLED.get(unit, unit)


@pytest.mark.parametrize("unit", BOMBS)
def test_what_is_no_unit_is_refused_at_once(unit: str, tmp_path: Path):
    begin = perf_counter()
    assert conversion(unit, "N") is None
    with contextlib.suppress(InputError):
        unit_of(tmp_path, unit)
    assert perf_counter() - begin < 1.0


def test_a_bomb_in_a_header_is_named(tmp_path: Path):
    file = tmp_path / "run.csv"
    file.write_text("force (10**10**10),x (mm)\n1,2\n2,3\n3,4\n")
    with raises("unknown-unit", "exponents up to 12"):
        read_csv(file, input="force (10**10**10)", output="x (mm)")


@pytest.mark.parametrize(
    "asked",
    [{"input_unit": "kN"}, {"input_unit": "K"}, {"output_unit": "um"}, {"time_unit": "ms"}],
)
def test_a_unit_that_the_file_has_otherwise_is_a_warning(tmp_path: Path, asked: dict[str, str]):
    file = tmp_path / "run.csv"
    rows = (f"{k},{np.sin(k)},{2 * np.sin(k)}" for k in range(40))
    file.write_text("\n".join(["t (s),force (N),x (mm)", *rows]))
    same = read_csv(file, "force (N)", "x (mm)", time="t (s)", output_unit="mm")
    assert "other-unit" not in [note.code for note in same.history]
    other = read_csv(file, "force (N)", "x (mm)", time="t (s)", **asked)
    verdict = identify.fit(other, "LinearSponge").verdict
    (said,) = (note for note in verdict.reasons if note.code == "other-unit")
    assert "no value is converted" in said


@pytest.mark.parametrize(
    ("header", "unit"), [("load (kg)", "kgf"), ("x (left)", "mm"), ("x (-)", "mm"), ("x", "mm")]
)
def test_a_unit_beside_what_is_none_is_no_other(tmp_path: Path, header: str, unit: str):
    file = tmp_path / "run.csv"
    file.write_text("\n".join([f"{header},y (mm)", *(f"{k},{k % 9}" for k in range(40))]))
    read = read_csv(file, header, "y (mm)", dt=1.0, input_unit=unit)
    assert "other-unit" not in [note.code for note in read.history]


@given(st.text(st.sampled_from("mN s1290.*/^()+-µ²e"), max_size=40))
def test_whatever_is_let_through_is_parsed_at_once(unit: str):
    """Names may be unknown to pint; nothing goes wrong, and nothing takes long."""
    begin = perf_counter()
    conversion(unit, "mm")
    assert perf_counter() - begin < 1.0
