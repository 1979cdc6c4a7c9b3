"""Lines of OpenSees: the force of the materials, recomputed from their text alone, is the model's."""

import numpy as np
import pytest

import identify
from compensate import material_card
from hysteresis import (
    BoucWen,
    GeneralizedKelvinVoigt,
    GeneralizedMaxwell,
    LinearSponge,
    MonotoneCurve,
    PrandtlIshlinskii,
    Record,
    Sum,
)
from tests.refusals import refuses
from tests.test_hysid.command import run
from tests.test_identify.lines import line, pressed

T = np.linspace(0, 12, 1201)
U = 0.8 * np.sin(2 * T) * (1 + 0.3 * np.sin(0.7 * T))
PLAYS = PrandtlIshlinskii(np.array([0.1, 0.4]), np.array([2.0, 1.5]), 0.7, leading=True)
CURVE = MonotoneCurve([-2.0, -0.5, 0.4, 2.0], [3.0, 0.4, 5.0])
WEN = BoucWen(k=3.0, alpha=0.2, yield_at=0.3, n=1.5, gamma_over_beta=0.4)
MAXWELL = GeneralizedMaxwell(1.0, [3.0, 2.0], [0.3, 5.0])
KELVIN = GeneralizedKelvinVoigt(4.0, [1.0, 3.0], [0.2, 90.0])


def force_of(text: str) -> np.ndarray:
    """The force of material 1 over T, by the equations of the manual."""
    lines = [line.split()[1:] for line in text.splitlines() if line.startswith("uniaxialMaterial")]
    materials = {tag: (name, values) for name, tag, *values in lines}
    return material(materials, "1")


def material(materials: dict[str, tuple[str, list[str]]], tag: str) -> np.ndarray:
    name, words = materials[tag]
    if name == "Parallel":
        return np.sum([material(materials, one) for one in words], 0)
    if name == "ElasticMultiLinear":
        middle = words.index("-stress")
        assert words[0] == "-strain"
        return np.interp(U, *(np.array(x, float) for x in (words[1:middle], words[middle + 1 :])))
    values = [float(word) for word in words]
    if name == "Elastic":
        return values[0] * U
    step = {"ElasticPP": plastic, "Maxwell": relaxed, "BoucWen": bouc_wen}[name](*values)
    force, found = 0.0, [0.0]
    for du in np.diff(U):
        force = step(force, du)
        found.append(force)
    if name == "BoucWen":  # the steps are those of z
        alpha, k = values[:2]
        return alpha * k * U + (1 - alpha) * k * np.array(found)
    return np.array(found)


def plastic(E: float, yields_at: float):
    return lambda force, du: float(np.clip(force + E * du, -E * yields_at, E * yields_at))


def relaxed(K: float, C: float, power: float, length: float):
    assert (power, length) == (1, 1)
    dt = T[1] - T[0]
    kept = np.exp(-dt * K / C)
    return lambda force, du: kept * force + C * du / dt * (1 - kept)


def bouc_wen(alpha, k, n, gamma, beta, A, *degrading):
    assert not any(degrading)

    def slope(z: float, du: float) -> float:
        return (A - abs(z) ** n * (gamma + beta * np.sign(du * z))) * du

    def step(z: float, du: float) -> float:
        small = du / 40
        for _ in range(40):  # Runge and Kutta's
            k1 = slope(z, small)
            k2 = slope(z + k1 / 2, small)
            k3 = slope(z + k2 / 2, small)
            z += (k1 + 2 * k2 + 2 * k3 + slope(z + k3, small)) / 6
        return z

    return step


@pytest.mark.parametrize(
    ("model", "near"),
    [(WEN, 1e-6), (PLAYS, 1e-9), (CURVE, 1e-9), (Sum(CURVE, PLAYS), 1e-9), (MAXWELL, 1e-9)],
    ids=["Bouc-Wen", "stops", "curve", "sum", "Maxwell"],
)
def test_the_force_of_the_lines_is_the_model_s(model, near):
    card = material_card("opensees", model, unit="N / mm")
    wanted = np.asarray(model.simulate(T, U))
    wanted = wanted - np.asarray(model.simulate(np.arange(2.0), np.zeros(2)))[0]
    assert U[0] == 0
    np.testing.assert_allclose(force_of(card.text), wanted, atol=near * np.ptp(wanted))
    assert "N / mm" in card.text


def test_a_model_that_creeps_moves_under_the_force_of_its_lines():
    force = force_of(material_card("opensees", KELVIN).text)
    # The force between two rows is no straight line, so the motion is right to the square of a step.
    np.testing.assert_allclose(np.asarray(KELVIN.simulate(T, force)), U, atol=3e-4)


def test_what_no_material_is_is_refused():
    for model in (LinearSponge(1.0, 0.0, 0.1), PrandtlIshlinskii(np.ones(1), np.ones(1), 1.0)):
        refuses("not-exportable", lambda model=model: material_card("opensees", model))


def test_a_fit_is_exported(tmp_path):
    force = np.asarray(WEN.simulate(T, U)) + 1e-3 * np.random.default_rng(0).normal(size=T.size)
    made = Record.from_arrays(U, force, T, input_unit="mm", output_unit="N")
    place = identify.save(identify.fit(made, WEN, starts=1, noise="gaussian"), tmp_path / "fit")
    assert run("export", place, "--to", "opensees", place / "foam.tcl").code == 0
    text = (place / "foam.tcl").read_text()
    assert "N / mm" in text
    np.testing.assert_allclose(force_of(text), force, atol=0.01)
    turned = identify.save(line(*pressed(1.2, 5.4, seed=0)), tmp_path / "turned")
    found = run("export", turned, "--to", "opensees", turned / "foam.tcl")
    assert "takes the deformation" in found.err
