"""Units are read by a grammar with limits; nothing calculates with what a stranger wrote."""

import contextlib
from pathlib import Path
from time import perf_counter

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hysteresis import InputError, read_csv
from hysteresis.internal import conversion
from tests.refusals import raises

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


@given(st.text(st.sampled_from("mN s1290.*/^()+-µ²e"), max_size=40))
def test_whatever_is_let_through_is_parsed_at_once(unit: str):
    """Names may be unknown to pint; nothing goes wrong, and nothing takes long."""
    begin = perf_counter()
    conversion(unit, "mm")
    assert perf_counter() - begin < 1.0
