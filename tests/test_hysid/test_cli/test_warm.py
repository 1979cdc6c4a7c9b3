"""`hysid warm`: what fits run is compiled before it is needed."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import identify
from compensate import invert
from hysteresis import PrandtlIshlinskii
from hysteresis.running import _over_time as over_time
from hysteresis.running._compiled import is_kept
from tests.test_hysid.command import run
from tests.test_identify.lines import line, pressed


def test_what_a_fit_runs_is_compiled(tmp_path: Path):
    pytest.importorskip("numba")
    model = PrandtlIshlinskii(np.array([0.5, 1.0]), np.array([0.3, 0.2]), 1.0)
    identify.save(replace(line(*pressed(1.2, 5.4, seed=0)), model=model), tmp_path / "fit")
    said = run("warm", tmp_path / "fit")
    assert (said.code, said.err) == (0, "")
    structure = invert(model).known.structure.bare  # type: ignore[attr-defined]
    assert is_kept(structure, "run")
    assert is_kept(structure, "find")
    assert run("warm", tmp_path / "fit").out == "0 loops are compiled.\n"


def test_without_numba_it_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    for module in ("hysid.commands._warm", "hysteresis.running._compiled"):
        monkeypatch.setattr(f"{module}.available", lambda: False)
    said = run("warm")
    assert said.code == 2
    assert "Numba cannot be imported" in said.err
    assert over_time.COMPILING["kept"] > 0.0
