"""A model of another distribution with its own law is exported like ours; see docs/your-own-model.md."""

import sys
from collections.abc import Callable
from importlib import import_module, reload
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from compensate import export_c, export_runtime, export_to, invert, runtime
from compensate.export.targets._export_to import TARGETS
from hysteresis import InputError, laws, parameter, register
from hysteresis.trees import AbstractSearchedModel, node
from tests.c_harness import Compiled, ran
from tests.judges import JUDGES
from tests.problems import random_histories

LAW = """\
from math import exp, fabs, pi
from numpy import sin

SHARE = 0.75

class Parameters:
    k: float

class State:
    status: int
    u: float

def gamma(p: Parameters, u: float) -> float:
    return SHARE * p.k * u + u / pi

def look(q: Parameters, memory: State, u: float) -> float:
    return gamma(q, u) + q.k * fabs(u - memory.u) * 0.25

def move(p: Parameters, s: State, u: float) -> float:
    y = look(p, s, u)
    s.u = u
    return y
"""


@pytest.fixture
def made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str], Any]:
    """A model of a law of this text."""
    monkeypatch.setattr(laws, "_ANNOUNCED", {})
    monkeypatch.syspath_prepend(tmp_path)

    def make(text: str, name: str = "") -> Any:
        name = name or f"law{abs(hash(text))}"
        (tmp_path / f"{name}.py").write_text(text)

        class Model(AbstractSearchedModel):
            k: float = parameter(2.0)

            def forwards(self) -> Any:
                return node(name, {"k": self.k}, {"u": 0.0})

        return register(Model, name=name, law=reload(import_module(name)))(2.0)

    return make


@pytest.fixture
def inputs() -> np.ndarray:
    return random_histories(np.random.default_rng(3), -2.0, 3.0, (1, 200))[0]


def test_its_c_and_its_python_give_the_estimates_of_its_inverse(duhem, inputs, tmp_path):
    y = np.asarray(duhem.simulate(None, inputs))
    np.testing.assert_allclose(invert(duhem).simulate(None, y).value, inputs, atol=1e-9)
    step = runtime.load(export_runtime(duhem, tmp_path / "duhem.json", y).path)
    values = [step.step(0.0, reading).value for reading in y]
    np.testing.assert_allclose(values, inputs, atol=1e-9)
    header = export_c(duhem, tmp_path / "duhem.h", y).path
    found, _ = Compiled(header, flags=("-O2", "-ffp-contract=off")).run(np.zeros(len(y)), y)
    np.testing.assert_array_equal(found, values)


def test_numbers_of_its_file_and_names_like_those_of_math_mean_the_same_in_c(
    made, inputs: np.ndarray, tmp_path: Path
):
    y = np.asarray(made(LAW).simulate(None, inputs))
    before = np.append(0.0, inputs[:-1])
    expected = 1.5 * inputs + inputs / np.pi + 0.5 * np.abs(inputs - before)
    np.testing.assert_allclose(y, expected, rtol=1e-12, atol=1e-12)
    header = export_c(made(LAW), tmp_path / "stranger.h", y).path
    found, _ = Compiled(header).run(np.zeros(len(y)), y)
    np.testing.assert_allclose(found, inputs, atol=1e-6)


@pytest.mark.parametrize(("old", "new"), [
    ("gamma(q, u) +", "sum([gamma(q, u)]) +"), ("gamma(q, u) +", "gamma(p=q, u=u) +"),
    ("gamma(q, u) +", "sin(u) +"), ("gamma(q, u) +", "+u +"), ("gamma(q, u) +", "u**2 +"),
    ("gamma(q, u) +", "q.other +"), ("gamma(q, u) +", "unknown +"),
    ("    s.u = u", "    s.u += u"), ("    s.u = u", "    p.k = u"),
    ("    s.u = u", "    while s.u < u:\n        s.u = u"),
    ("    s.u = u", "    for k in range(0, 9, 2):\n        s.u = u"),
    ("    s.u = u", "    s.u = u if 0.0 < u < 1.0 else 0.0"),
    ("    k: float", "    k: complex"), ("p: Parameters, u: float", "p, u"),
])  # fmt: skip
def test_what_no_language_knows_is_refused_when_the_law_is_registered(made, old, new):
    text = LAW.replace(old, new, 1)
    with pytest.raises(InputError) as caught:
        made(text)
    error = caught.value
    assert error.code == "untranslatable-law"
    line = text.splitlines()[int(error.place.rpartition(".py:")[2]) - 1]
    assert line not in LAW.splitlines() or "def gamma(p, u)" in text
    assert error.cause
    assert error.fix


@pytest.mark.parametrize("target", TARGETS)
def test_it_goes_to_every_target(duhem: Any, inputs: np.ndarray, target: str, tmp_path: Path):
    y = np.asarray(duhem.simulate(None, inputs))
    assert export_to(target, duhem, tmp_path / f"duhem_{target}", y).path.exists()


@JUDGES["scikit-learn"].needed
def test_a_package_for_sklearn_brings_its_law(duhem: Any, inputs: np.ndarray, tmp_path: Path):
    y = np.asarray(duhem.simulate(None, inputs))
    export_to("sklearn", duhem, tmp_path / "sensor", y)
    code = (
        "import sys, numpy as np; from sensor import Compensator\n"
        f"y = np.array({y[:9].tolist()})[:, None]\n"
        "found = Compensator().fit(y).transform(y)\n"
        f"assert np.abs(found[:, 0] - {inputs[:9].tolist()}).max() < 1e-9\n"
        "assert 'hysteresis' not in sys.modules\n"
    )
    ran(sys.executable, "-c", code, cwd=tmp_path, env={})


def test_a_file_with_a_law_that_nobody_announced_is_refused(duhem, inputs, tmp_path, monkeypatch):
    y = np.asarray(duhem.simulate(None, inputs))
    file = export_runtime(duhem, tmp_path / "duhem.json", y).path
    monkeypatch.setattr(laws, "_ANNOUNCED", {})
    with pytest.raises(ValueError, match="hysid_duhem_law"):
        runtime.load(file)


@pytest.mark.parametrize("name", ["sum", "hysid_other.hysid_duhem_law"])
def test_a_law_has_its_parts_and_a_name_of_its_own(duhem: Any, name: str):
    with pytest.raises(ValueError, match="no law"):
        laws.announce(ModuleType(name))
    made = ModuleType(name)
    for part in ("Parameters", "State", "look", "move"):
        setattr(made, part, object)
    with pytest.raises(ValueError, match="another law"):
        laws.announce(made)
