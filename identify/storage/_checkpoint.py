"""Chains kept on disk while they are drawn, so that a kill at any moment costs some seconds of work."""

import hashlib
import io
import os
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from hysteresis import InputError

FORMAT = 1
ARRAYS = ("points", "log_probability", "accepted", "random_keys", "random_rest", "place", "root")
AT_MOST = 0.1
"""Part of the time that writing may take; long chains are written less often."""


class History(NamedTuple):
    """Everything a run goes on from.

    - `points`, `log_probability`: (ensembles, steps + 1, walkers, parameters) and the same without the
      parameters, the first walkers included.
    - `accepted`: proposals taken by each walker so far.
    - `random`: the state of NumPy's Mersenne twister, as `RandomState.get_state` gives it.
    - `place`, `root`: where proposals are drawn from, see `SideBySide`.
    """

    points: Float[np.ndarray, "ensembles rows walkers parameters"]
    log_probability: Float[np.ndarray, "ensembles rows walkers"]
    accepted: Int[np.ndarray, "ensembles walkers"]
    random: tuple[Any, ...]
    place: Float[np.ndarray, " parameters"]
    root: Float[np.ndarray, "parameters parameters"]


class Identity(NamedTuple):
    """What has to be the same for chains to go on bit for bit, each a digest or a few words."""

    model: str = ""
    data: str = ""
    noise: str = ""
    priors: str = ""
    seed: str = ""
    ensembles: str = ""
    walkers: str = ""
    versions: str = ""


@dataclass
class Checkpoint:
    """An HDF5 file of the chains, and beside it the one before: `chains.h5`, `chains.previous.h5`.

    HDF5 cut off in mid-write cannot be read. So a checkpoint is made in memory, written to a new file,
    synced to the disk, and only then given the name; the file of that name becomes the previous one.
    A kill between any two of these leaves at least one whole file.

    - `file`: its name; None keeps nothing.
    - `identity`: what the chains belong to. `resume`: go on from them. `every`: seconds between writes.
    - `said`: what to tell the user of its reading.
    """

    file: Path | None
    identity: Identity = field(default_factory=Identity)
    resume: bool = False
    every: float = 10.0
    said: list[str] = field(default_factory=list)
    _safe: int = 0
    _cost: float = 0.0

    @property
    def previous(self) -> Path:
        """The file that was written before."""
        assert self.file is not None
        return self.file.with_suffix(f".previous{self.file.suffix}")

    def is_due(self, since: float) -> bool:
        """Whether to write again, `since` seconds after the last time."""
        return since >= max(self.every, self._cost / AT_MOST)

    def write(self, history: History) -> None:
        """Keep the chains. Raises `InputError` where the disk does not take them; what was there stays."""
        if self.file is None:
            return
        begin, new = perf_counter(), self.file.with_suffix(f".new{self.file.suffix}")
        try:
            with new.open("wb") as handle:
                handle.write(_to_bytes(history, self.identity))
                handle.flush()
                os.fsync(handle.fileno())
            if self.file.exists():
                os.replace(self.file, self.previous)
            os.replace(new, self.file)
            _sync_folder(self.file.parent)
        except OSError as error:
            new.unlink(missing_ok=True)
            raise InputError(
                "cannot-write",
                f"the chains cannot be written: {error.strerror or error}. {self._safe:,} steps of every"
                f" ensemble are safe, of {_steps(history):,}.",
                place=str(self.file),
                cause="the disk or a quota is full, or the folder may not be written to.",
                fix="make room, then go on: hysid sample DIR --resume (in Python resume=True).",
            ) from error
        self._safe, self._cost = _steps(history), perf_counter() - begin

    def read(self) -> History | None:
        """The chains to go on from; None without `resume`, or where nothing was kept yet.

        Raises `InputError` where they belong to something else, or neither file can be read.
        """
        if self.file is None or not self.resume:
            return None
        there = [file for file in (self.file, self.previous) if file.exists()]
        faults = []
        for file in there:
            try:
                history, identity = _from_bytes(file.read_bytes())
            except (OSError, KeyError, ValueError, RuntimeError) as error:
                faults.append(f"{file.name}: {error}")
                continue
            self._check(file, identity)
            self._safe = _steps(history)
            if faults:
                self.said.append(
                    f"{self.file.name} is damaged, so {file.name} was gone on from, at step"
                    f" {self._safe:,}: {faults[0]}."
                )
            return history
        if there:
            raise InputError(
                "damaged-file",
                f"no checkpoint can be read. {'; '.join(faults)}.",
                place=str(self.file),
                cause="the files were cut off or changed, or another version wrote them.",
                fix="sample from the beginning, without --resume.",
            )
        self.said.append(f"no chains were kept in {self.file.name}: sampled from the beginning.")
        return None

    def check_length(self, steps: int | None, done: int) -> None:
        """Raise `InputError` where more steps were kept than are asked for: none are thrown away."""
        if steps is not None and done > steps:
            raise InputError(
                "more-steps-kept",
                f"{done:,} steps were kept already, and {steps:,} are asked for.",
                place=str(self.file),
                cause="steps count from the beginning, those of before included.",
                fix=f"ask for at least {done:,}, or sample without --resume.",
            )

    def _check(self, file: Path, identity: dict[str, str]) -> None:
        own = self.identity._asdict()
        other = [name for name in own if identity.get(name) != own[name]]
        if other:
            told = ("seed", "ensembles", "walkers", "versions")
            differ = [
                f"{name} ({identity.get(name)}, now {own[name]})" if name in told else name
                for name in other
            ]
            raise InputError(
                "other-checkpoint",
                f"the chains were drawn with another {', another '.join(differ)}.",
                place=str(file),
                cause="the fit was made again, or other options were given.",
                fix="give the options of then, or another file, or sample without --resume.",
            )


def digest(*parts: Any) -> str:
    """A short digest of arrays and of whatever `repr` tells apart."""
    made = hashlib.sha256()
    for part in parts:
        if isinstance(part, np.ndarray):
            made.update(f"{part.dtype.str}{part.shape}".encode())
            made.update(np.ascontiguousarray(part).tobytes())
        else:
            made.update(repr(part).encode())
    return made.hexdigest()[:16]


def _steps(history: History) -> int:
    return history.points.shape[1] - 1


def _arrays(history: History) -> dict[str, np.ndarray]:
    kind, keys, *rest = history.random
    assert kind == "MT19937"
    return {
        "points": history.points,
        "log_probability": history.log_probability,
        "accepted": history.accepted,
        "random_keys": keys,
        "random_rest": np.array(rest, float),
        "place": history.place,
        "root": history.root,
    }


def _to_bytes(history: History, identity: Identity) -> bytes:
    import h5py

    arrays = _arrays(history)
    with h5py.File("chains", "w", driver="core", backing_store=False) as file:
        file.attrs.update(
            identity._asdict() | {"format": FORMAT, "checksum": digest(*arrays.values())}
        )
        for name, array in arrays.items():
            file.create_dataset(name, data=array)
        file.flush()
        return file.id.get_file_image()


def _from_bytes(image: bytes) -> tuple[History, dict[str, str]]:
    """Raises `OSError`, `KeyError`, `ValueError` or `RuntimeError` where it is damaged."""
    import h5py

    with h5py.File(io.BytesIO(image), "r") as file:
        words: dict[str, Any] = dict(file.attrs)
        if words.get("format") != FORMAT:
            raise ValueError(f"format {words.get('format')}, not {FORMAT}")
        arrays = {name: np.asarray(file[name]) for name in ARRAYS}
    if digest(*arrays.values()) != words["checksum"]:
        raise ValueError("its checksum does not agree")
    keys, (place, has_gauss, gauss) = arrays.pop("random_keys"), arrays.pop("random_rest")
    random = ("MT19937", keys, int(place), int(has_gauss), float(gauss))
    return History(**arrays, random=random), words


def _sync_folder(folder: Path) -> None:
    """So that the new name survives a power cut; there is no such thing on Windows."""
    if os.name == "posix":
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
