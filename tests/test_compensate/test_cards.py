"""Material cards: each card's curve, recomputed from its text alone, is the fit's."""

import re
from collections.abc import Callable
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from compensate import material_card
from hysteresis import GeneralizedKelvinVoigt, GeneralizedMaxwell, LinearSponge
from tests.refusals import refuses

NU = 0.37
T = np.geomspace(1e-4, 1e6, 200)
Curve = tuple[np.ndarray, np.ndarray]
"""Moduli in tension and in shear over T."""


def numbers(line: str) -> list[float]:
    return [float(x) for x in re.split(r"[,\s]+", line.strip()) if x]


def made(at_end: float, terms: Any, times: Any) -> np.ndarray:
    return at_end + np.exp(-T[:, None] / np.asarray(times)) @ np.asarray(terms)


def relative(E0: float, nu: float, g: Any, k: Any, tau: Any) -> Curve:
    assert nu == NU
    np.testing.assert_array_equal(g, k)
    E = E0 * made(1 - np.sum(g), g, tau)
    return E, E / (2 * (1 + nu))


def of_both(shear: np.ndarray, bulk: np.ndarray) -> Curve:
    return 9 * bulk * shear / (3 * bulk + shear), shear


def abaqus(text: str) -> Curve:
    text = re.sub(r"\*\*.*\n", "", text)
    parts = [part.split("\n", 1) for part in re.split(r"^\*", text, flags=re.MULTILINE)[1:]]
    blocks = dict(parts)  # type: ignore[arg-type]
    E0, nu = numbers(blocks["ELASTIC, MODULI=INSTANTANEOUS"])
    rows = [numbers(line) for line in blocks["VISCOELASTIC, TIME=PRONY"].splitlines()]
    return relative(E0, nu, *np.transpose(rows))


def ansys(text: str) -> Curve:
    parts: dict[str, list[float]] = {}
    moduli: dict[str, float] = {}
    part, count = "", 0
    for line in text.splitlines():
        words = [word.strip() for word in line.split(",")]
        if words[0] in ("MP", "MPDATA"):
            moduli[words[1]] = float(words[-1])
        elif words[0] == "TB" and words[1] in ("PRONY", "PRON"):
            part, count = words[5][:4], int(words[4])
        elif words[0] == "TBDATA":
            parts.setdefault(part, []).extend(map(float, words[2:]))
    shear, bulk = (np.reshape(parts[name], (count, 2)) for name in ("SHEA", "BULK"))
    np.testing.assert_array_equal(shear, bulk)
    return relative(moduli["EX"], moduli["NUXY"], shear[:, 0], bulk[:, 0], shear[:, 1])


def comsol(text: str) -> Curve:
    rows = [line.split()[:2] for line in text.splitlines()]
    found = {name: float(value.split("[")[0]) for name, value in rows}
    count = sum(name.startswith("tau") for name in found)
    G, K, tau = ([found[f"{name}{k + 1}"] for k in range(count)] for name in ("G", "K", "tau"))
    E, nu = found["E_inf"], found["nu"]
    return of_both(made(E / (2 * (1 + nu)), G, tau), made(E / (3 * (1 - 2 * nu)), K, tau))


def ls_dyna(text: str) -> Curve:
    lines = [line for line in text.splitlines() if not line.startswith("$")]
    assert lines[0].endswith("+")  # fields of twenty characters
    fields = [[float(line[k : k + 20]) for k in range(0, len(line), 20)] for line in lines[1:]]
    G, beta = np.transpose(fields[2:])
    shear = np.exp(-T[:, None] * beta) @ G
    return 2 * (1 + NU) * shear, shear


def openradioss(text: str) -> Curve:
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    E, nu = numbers(lines[3])
    G, beta, K, same = np.transpose([numbers(line) for line in lines[6:]])
    assert len(G) == int(lines[5][:10])
    np.testing.assert_array_equal(beta, same)
    return of_both(made(E / (2 * (1 + nu)), G, 1 / beta), made(E / (3 * (1 - 2 * nu)), K, 1 / beta))


def calculix(text: str) -> Curve:
    E = np.zeros(len(T))
    for block in text.split("*MATERIAL")[1:]:
        lines = block.splitlines()
        (stiffness, nu), rate = numbers(lines[2]), 0.0
        assert nu == NU
        if len(lines) > 3:
            A, n, m = numbers(lines[4])
            assert (lines[3], n, m) == ("*CREEP, LAW=NORTON", 1, 0)
            rate = A * stiffness
        E += stiffness * np.exp(-T * rate)
    return E, E / (2 * (1 + NU))


def febio(text: str) -> Curve:
    root = ElementTree.fromstring(f"<x>{text}</x>").find("material")
    found = {one.tag: float(one.text) for one in root.iter() if one.text and one.text.strip()}
    count = sum(re.fullmatch(r"t\d+", name) is not None for name in found)
    g, tau = ([found[f"{name}{k + 1}"] for k in range(count)] for name in ("g", "t"))
    E = found["E"] * made(found["g0"], g, tau)
    return E, E / (2 * (1 + found["v"]))


READ: dict[str, Callable[[str], Curve]] = {
    "abaqus": abaqus, "apdl": ansys, "mpl": ansys, "comsol": comsol, "ls-dyna": ls_dyna,
    "openradioss": openradioss, "calculix": calculix, "febio": febio,
}  # fmt: skip
MAXWELL = GeneralizedMaxwell(3.0, [2.0, 40.0, 500.0], [1e3, 0.7, 1e-3])
KELVIN = GeneralizedKelvinVoigt(4.0, [1.0, 3.0], [0.2, 90.0])
FLOWING = GeneralizedKelvinVoigt(4.0, [1.0, 3.0], [0.2, 90.0], 5e3)


@pytest.mark.parametrize("program", READ)
@pytest.mark.parametrize("model", [MAXWELL, KELVIN, FLOWING], ids=["Maxwell", "Kelvin", "flowing"])
@pytest.mark.parametrize("shear", [False, True])
def test_the_curve_of_a_card_is_the_fit_s(program: str, model: Any, shear: bool):
    card = material_card(program, model, poisson=NU, shear=shear, unit="MPa")
    found = READ[program](card.text)[int(shear)]
    wanted = np.asarray(model.relaxation_modulus(T))
    np.testing.assert_allclose(found, wanted, rtol=1e-6, atol=1e-9 * wanted[0])
    assert "MPa" in card.text
    assert any("Poisson" in note for note in card.notes)


def test_these_readers_read_a_card_that_ansys_wrote(measured_data, monkeypatch):
    """Of public data: its 31 terms leave 0.25 % of the reading."""
    folder = measured_data / "relaxation-master"
    text = (folder / "time_prony_terms.MPL").read_text()
    t, y = np.loadtxt(folder / "time_user_master.csv", delimiter=",", skiprows=2).T
    monkeypatch.setitem(globals(), "T", t)
    # The file has shear terms alone, and no modulus.
    E, _ = ansys(f"{text}{text.replace('SHEA', 'BULK')}MP,EX,1,1\nMP,NUXY,1,{NU}\n")
    scale = np.sum(E / y) / np.sum((E / y) ** 2)
    assert np.sqrt(np.mean((scale * E / y - 1) ** 2)) < 0.0026


@pytest.mark.parametrize("program", READ)
def test_shift_factors_are_in_the_card_or_said_to_be_missing(program: str):
    card = material_card(program, MAXWELL, wlf=(20.0, 17.44, 51.6), name="PUR & WLF--2")
    assert "&" not in card.text
    assert ("17.44" in card.text) != any("shift factors" in note for note in card.notes)


@pytest.mark.parametrize(("program", "model", "options", "code"), [
    ("nastran", MAXWELL, {}, "bad-option"),
    ("abaqus", MAXWELL, {"poisson": 0.5}, "bad-option"),
    ("abaqus", LinearSponge(1.0), {}, "not-exportable"),
    ("abaqus", GeneralizedMaxwell(1.0, [0.0], [1.0]), {}, "not-exportable"),
    ("abaqus", GeneralizedKelvinVoigt(np.inf, [1.0], [1.0]), {}, "not-exportable"),
    ("febio", GeneralizedMaxwell(1.0, np.ones(7), np.arange(1.0, 8.0)), {}, "not-exportable"),
])  # fmt: skip
def test_what_has_no_card(program: str, model: Any, options: dict[str, Any], code: str):
    refuses(code, lambda: material_card(program, model, **options))
