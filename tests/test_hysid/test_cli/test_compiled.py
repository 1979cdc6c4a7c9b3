"""A command finds what an earlier one has compiled; `hysid warm` compiles beforehand."""

import os
import sys
from dataclasses import replace
from pathlib import Path
from unittest.mock import patch

import jax
import numpy as np
import pytest

import identify
from compensate import invert
from hysid import _compile_cache as _compiled
from hysid._compile_cache import keep_compiled
from hysteresis import PrandtlIshlinskii
from hysteresis.running import _over_time as over_time
from hysteresis.running._compiled import is_kept
from tests.c_harness import ran
from tests.test_hysid.command import ENVIRONMENT, run
from tests.test_identify.lines import line, pressed
from tests.thorough import rest_thorough

FOLDER = "JAX_COMPILATION_CACHE_DIR"
OURS = {key: value for key, value in ENVIRONMENT.items() if not key.startswith("JAX_")}


def kept(**environment: str) -> dict[str, str]:
    """What the environment is after `keep_compiled`, and what that said."""
    with patch.dict(os.environ, OURS | environment, clear=True):
        jax.config.update("jax_enable_compilation_cache", True)
        try:
            return {"said": keep_compiled(), **os.environ}
        finally:
            jax.config.update("jax_enable_compilation_cache", False)
            jax.config.update("jax_compilation_cache_dir", None)


COMMAND = """
from hysid._compile_cache import keep_compiled
keep_compiled()
import jax
"""
PROGRAM = """
import jax
jax.jit(lambda x: x - 1)(3.0)
from hysid._compile_cache import keep_compiled
keep_compiled()
"""


@pytest.mark.parametrize("begin", rest_thorough([COMMAND, PROGRAM], 1))
def test_the_second_process_compiles_nothing(begin: str, tmp_path: Path):
    code = f"""{begin}
hits = []
jax.monitoring.register_event_listener(lambda name, **_: hits.append("cache_hits" in name))
jax.jit(lambda x: 2 * x + 1)(3.0)
print(sum(hits))"""

    def hits() -> int:
        environment = OURS | {"XDG_CACHE_HOME": str(tmp_path), "JAX_PLATFORMS": "cpu"}
        done = ran(sys.executable, "-c", code, env=environment)
        assert done.stderr == ""
        return int(done.stdout)

    assert hits() == 0
    assert hits() > 0
    (folder,) = (tmp_path / "hysid").iterdir()
    for file in folder.iterdir():  # as a full disk leaves it
        file.write_bytes(file.read_bytes()[:20])
    assert hits() == 0


def test_without_a_home_nothing_is_kept(tmp_path: Path):
    (tmp_path / "file").write_text("")
    assert FOLDER not in kept(XDG_CACHE_HOME=str(tmp_path / "file"))


def test_the_oldest_go_when_there_are_too_many(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    place = {"XDG_CACHE_HOME": str(tmp_path)}
    folder = Path(kept(**place)[FOLDER])
    names = [f"jit_f-{k:064x}-cache" for k in range(10)]
    for k, name in enumerate(names):
        (folder / name).write_bytes(bytes(10))
        os.utime(folder / name, (k, k))
    monkeypatch.setattr(_compiled, "MOST", 100)
    kept(**place)
    assert len(list(folder.iterdir())) == 10
    monkeypatch.setattr(_compiled, "MOST", 99)
    kept(**place)
    assert sorted(file.name for file in folder.iterdir()) == names[6:]


def test_only_its_own_files_go(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Neither what others have named, nor what a link of the right name leads to."""
    place = {"XDG_CACHE_HOME": str(tmp_path)}
    folder = Path(kept(**place)[FOLDER])
    (folder / "thesis.tex").write_bytes(bytes(1000))
    (tmp_path / "mine").write_bytes(bytes(1000))
    (folder / f"jit_f-{0:064x}-cache").symlink_to(tmp_path / "mine")
    monkeypatch.setattr(_compiled, "MOST", 10)
    kept(**place)
    assert (folder / "thesis.tex").exists()
    assert (tmp_path / "mine").exists()


def test_the_folder_is_for_one_user(tmp_path: Path):
    place = {"XDG_CACHE_HOME": str(tmp_path)}
    folder = Path(kept(**place)[FOLDER])
    for it in (folder, folder.parent):
        assert it.stat().st_mode & 0o777 == 0o700
    folder.chmod(0o755)  # as earlier versions made it
    assert kept(**place)[FOLDER] == str(folder)
    assert folder.stat().st_mode & 0o777 == 0o700


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="no modes of files")
@pytest.mark.parametrize("which", ["cache", "hysid", "compiled"])
@pytest.mark.parametrize("how", ["writable", "link", "foreign"])
def test_a_folder_of_others_is_not_used(which: str, how: str, tmp_path, monkeypatch):
    """And the command goes on without."""
    place = {"XDG_CACHE_HOME": str(tmp_path / "cache")}
    folder = Path(kept(**place)[FOLDER])
    it = {"cache": folder.parents[1], "hysid": folder.parent, "compiled": folder}[which]
    if how == "writable":
        it.chmod(0o777)
    elif how == "link":
        it.rename(tmp_path / "elsewhere")
        it.symlink_to(tmp_path / "elsewhere")
    else:
        uid = os.getuid()
        monkeypatch.setattr(os, "getuid", lambda: uid + 1)
    before = sorted(tmp_path.rglob("*"))
    if which == "cache" and how == "link":  # a home may lie on another disk
        assert kept(**place)[FOLDER] == str(folder)
        return
    assert FOLDER not in kept(**place)
    assert sorted(tmp_path.rglob("*")) == before
    assert str(it if how != "foreign" else tmp_path) in kept(**place)["said"]


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
