"""A model of another distribution with its own law is exported like ours; see docs/your-own-model.md."""

import subprocess
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from compensate import export_c, export_runtime, invert, runtime
from compensate.export.targets._export_to import TARGETS, export_to
from hysteresis import laws
from tests.c_harness import Compiled
from tests.judges import JUDGES
from tests.problems import random_histories

TEMPLATE = Path(__file__).parents[2] / "docs" / "template"


@pytest.fixture
def duhem(monkeypatch: pytest.MonkeyPatch) -> Any:
    """A model of the template distribution."""
    monkeypatch.syspath_prepend(TEMPLATE)
    __import__("hysid_duhem")
    return sys.modules["hysid_duhem"].Duhem(0.5, 1.0, 0.7)


@pytest.fixture
def inputs() -> np.ndarray:
    return random_histories(np.random.default_rng(3), -2.0, 3.0, (1, 200))[0]


def test_its_c_and_its_python_give_the_estimates_of_its_inverse(
    duhem: Any, inputs: np.ndarray, tmp_path: Path
):
    y = np.asarray(duhem.simulate(None, inputs))
    np.testing.assert_allclose(invert(duhem).simulate(None, y).value, inputs, atol=1e-9)
    step = runtime.load(export_runtime(duhem, tmp_path / "duhem.json", y).path)
    values = [step.step(0.0, reading).value for reading in y]
    np.testing.assert_allclose(values, inputs, atol=1e-9)
    header = export_c(duhem, tmp_path / "duhem.h", y).path
    found, _ = Compiled(header, flags=("-O2", "-ffp-contract=off")).run(np.zeros(len(y)), y)
    np.testing.assert_array_equal(found, values)


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
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, env={}
    )
    assert done.returncode == 0, done.stderr


def test_a_file_with_a_law_that_nobody_announced_is_refused(
    duhem: Any, inputs: np.ndarray, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
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
