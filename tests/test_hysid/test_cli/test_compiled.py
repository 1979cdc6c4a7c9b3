"""A command finds what an earlier one has compiled."""

import os
import subprocess
import sys
from pathlib import Path
from unittest.mock import patch

import pytest

from hysid.cli import _compile_cache as _compiled
from hysid.cli._compile_cache import keep_compiled
from tests.test_hysid.command import ENVIRONMENT

FOLDER = "JAX_COMPILATION_CACHE_DIR"
OURS = {key: value for key, value in ENVIRONMENT.items() if not key.startswith("JAX_")}


def kept(**environment: str) -> dict[str, str]:
    """What the environment is after `keep_compiled`."""
    with patch.dict(os.environ, OURS | environment, clear=True):
        keep_compiled()
        return dict(os.environ)


def test_the_second_process_compiles_nothing(tmp_path: Path):
    code = """if True:
        from hysid.cli._compile_cache import keep_compiled
        keep_compiled()
        import jax
        hits = []
        jax.monitoring.register_event_listener(lambda name, **_: hits.append("cache_hits" in name))
        jax.jit(lambda x: 2 * x + 1)(3.0)
        print(sum(hits))"""

    def hits() -> int:
        environment = OURS | {"XDG_CACHE_HOME": str(tmp_path), "JAX_PLATFORMS": "cpu"}
        done = subprocess.run(
            [sys.executable, "-c", code], env=environment, capture_output=True, text=True
        )
        assert (done.returncode, done.stderr) == (0, "")
        return int(done.stdout)

    assert hits() == 0
    assert hits() > 0
    (folder,) = (tmp_path / "hysid").iterdir()
    for file in folder.iterdir():  # as a full disk leaves it
        file.write_bytes(file.read_bytes()[:20])
    assert hits() == 0


def test_the_users_word_counts(tmp_path: Path):
    place = {"XDG_CACHE_HOME": str(tmp_path)}
    assert FOLDER not in kept(**place, JAX_ENABLE_COMPILATION_CACHE="0")
    assert kept(**place, **{FOLDER: "elsewhere"})[FOLDER] == "elsewhere"
    assert not any(tmp_path.iterdir())


def test_without_a_home_nothing_is_kept(tmp_path: Path):
    (tmp_path / "file").write_text("")
    assert FOLDER not in kept(XDG_CACHE_HOME=str(tmp_path / "file"))


def test_the_oldest_go_when_there_are_too_many(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    place = {"XDG_CACHE_HOME": str(tmp_path)}
    folder = Path(kept(**place)[FOLDER])
    for k in range(10):
        (folder / str(k)).write_bytes(bytes(10))
        os.utime(folder / str(k), (k, k))
    monkeypatch.setattr(_compiled, "MOST", 100)
    kept(**place)
    assert len(list(folder.iterdir())) == 10
    monkeypatch.setattr(_compiled, "MOST", 99)
    kept(**place)
    assert sorted(file.name for file in folder.iterdir()) == ["6", "7", "8", "9"]
