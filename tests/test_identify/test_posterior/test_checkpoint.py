"""Checkpoints of chains: a run resumes bit for bit after a kill, or is refused with a reason."""

import os
import resource
import shutil
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hysteresis import InputError
from identify.posterior._emcee import sample_ensembles
from identify.storage._checkpoint import Checkpoint

OWN = {"model": "m", "data": "d", "seed": "0", "versions": "emcee 3"}
STEPS = 120


def density(points: np.ndarray) -> np.ndarray:
    return -0.5 * (points**2).sum(1) - points[:, 0] ** 4


def drawn(
    file: Path | None, *, steps: int | None = STEPS, resume: bool = False, every: float = 1e9,
    identity: dict[str, str] = OWN, progress=lambda *_: None, said: list[str] | None = None,
) -> Any:  # fmt: skip
    first = np.random.default_rng(0).normal(size=(3, 8, 2))
    kept = Checkpoint(file, identity, resume, every, [] if said is None else said)
    place, root = np.zeros(2), np.eye(2)
    return sample_ensembles(density, first, place, root, 0, steps, 1000, kept, progress)


def interrupting(at: int):
    def progress(done: int, *_: object) -> None:
        if done >= at:
            raise KeyboardInterrupt

    return progress


@pytest.fixture(scope="module")
def whole() -> Any:
    return drawn(None)


@pytest.fixture(autouse=True)
def short_blocks(monkeypatch):
    monkeypatch.setattr("identify.posterior._emcee.MOMENT", 0.002)


@pytest.fixture
def file(tmp_path) -> Path:
    """Chains of 40 steps."""
    drawn(tmp_path / "chains.npz", steps=40)
    return tmp_path / "chains.npz"


def same(one: Any, other: Any) -> None:
    np.testing.assert_array_equal(one.points, other.points)
    np.testing.assert_array_equal(one.log_probability, other.log_probability)
    assert (one.acceptance, one.method) == (other.acceptance, other.method)


def test_interrupted_chains_go_on_bit_for_bit(whole, tmp_path) -> None:
    file = tmp_path / "chains.npz"
    for at in (1, 17, 60):
        with suppress(KeyboardInterrupt):  # from 20 steps on the chains so far are the result
            assert "interrupted" in drawn(file, resume=True, progress=interrupting(at)).notes[-1]
    same(drawn(file, resume=True), whole)
    same(drawn(file, resume=True), whole)  # there is nothing left to do


def test_a_full_disk_costs_nothing_that_was_kept(file, whole) -> None:
    """Files may not grow beyond what 60 steps take, as on a disk that is full."""
    size, limits = file.stat().st_size, resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (int(1.5 * size), limits[1]))
    try:
        with pytest.raises(InputError, match="steps are safe") as error:
            drawn(file, resume=True, every=0.0)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert error.value.code == "cannot-write"
    assert "--resume" in error.value.fix
    assert sorted(os.listdir(file.parent)) == ["chains.npz"]
    same(drawn(file, resume=True), whole)


def test_a_kill_between_any_two_lines_leaves_a_whole_file(whole, tmp_path, monkeypatch) -> None:
    """Every call of the system that a write makes dies once, before and after it is done."""
    file = tmp_path / "chains.npz"
    drawn(file, steps=40)
    for name in ("replace", "fsync"):
        for after in (False, True):
            folder = tmp_path / f"{name}{after}"
            folder.mkdir()
            shutil.copy(file, folder / "chains.npz")
            real = getattr(os, name)

            def dies(*arguments, real=real, after=after):
                if after:
                    real(*arguments)
                raise SystemExit

            monkeypatch.setattr(os, name, dies)
            with pytest.raises(SystemExit):
                drawn(folder / "chains.npz", resume=True)
            monkeypatch.setattr(os, name, real)
            same(drawn(folder / "chains.npz", resume=True), whole)
