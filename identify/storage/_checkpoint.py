"""Checkpoints of Markov chains: a run that is killed at any moment loses a few seconds of work."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from hysteresis import InputError
from hysteresis._limits import DAMAGE
from hysteresis.records.importers._hdf5 import opened_hdf5

from ._checkpoint_file import CheckpointFile, check_identity, digest

FORMAT = 1
ARRAYS = ("points", "log_probability", "accepted", "random_keys", "random_rest", "place", "root")


class History(NamedTuple):
    """All that a run needs to resume.

    - `points`, `log_probability`: (ensembles, steps + 1, walkers, parameters) and the same without the
      parameters, the first walkers included.
    - `accepted`: proposals taken by each walker so far.
    - `random`: the state of NumPy's Mersenne twister, as `RandomState.get_state` gives it.
    - `place`, `root`: the affine map of the proposals, see `SideBySide`.
    """

    points: Float[np.ndarray, "ensembles rows walkers parameters"]
    log_probability: Float[np.ndarray, "ensembles rows walkers"]
    accepted: Int[np.ndarray, "ensembles walkers"]
    random: tuple[Any, ...]
    place: Float[np.ndarray, " parameters"]
    root: Float[np.ndarray, "parameters parameters"]


class Identity(NamedTuple):
    """What must be the same for chains to resume bit for bit: a digest or a few words each."""

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
    """An HDF5 file of the chains, and the one before it: `chains.h5` and `chains.previous.h5`.

    A kill at any moment leaves at least one complete file, see `CheckpointFile`.

    - `file`: its name; None keeps nothing.
    - `identity`: which run the chains belong to. `resume`: continue it. `every`: seconds between writes.
    - `said`: notes for the user about what was read.
    """

    file: Path | None
    identity: Identity = field(default_factory=Identity)
    resume: bool = False
    every: float = 10.0
    said: list[str] = field(default_factory=list)
    _safe_steps: int = 0
    _kept: CheckpointFile = field(init=False)

    def __post_init__(self) -> None:
        self._kept = CheckpointFile(self.file, self.every, keeps_previous=True)

    def is_due(self, since: float) -> bool:
        """Whether to write again, `since` seconds after the last write."""
        return self._kept.is_due(since)

    def write(self, history: History) -> None:
        """Keep the chains. Raises `InputError` if they cannot be written; the old file stays."""
        if self.file is None:
            return
        self._kept.write(
            _to_bytes(history, self.identity),
            "the chains",
            safe=f"{self._safe_steps:,} steps of every ensemble are safe, of {_steps(history):,}.",
            fix="make room, then resume: hysid sample DIR --resume (in Python resume=True).",
        )
        self._safe_steps = _steps(history)

    def read(self) -> History | None:
        """The chains to resume; None without `resume`, or if nothing was kept yet.

        Raises `InputError` if they belong to another run, or if neither file can be read.
        """
        if self.file is None or not self.resume:
            return None
        there = [file for file in (self.file, self._kept.previous) if file.exists()]
        faults = []
        for file in there:
            try:
                history, identity = _from_bytes(file.read_bytes())
            except DAMAGE as error:
                faults.append(f"{file.name}: {error}")
                continue
            check_identity(
                file, self.identity._asdict(), identity, verb="the chains were drawn",
                shown=("seed", "ensembles", "walkers", "versions"),
                fix="give the options of then, or another file, or sample without --resume.",
            )  # fmt: skip
            self._safe_steps = _steps(history)
            if faults:
                self.said.append(
                    f"{self.file.name} is damaged, so the run resumed from {file.name}, at step"
                    f" {self._safe_steps:,}: {faults[0]}."
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
        self.said.append(
            f"no chains were kept in {self.file.name}, so sampling began from the start."
        )
        return None

    def check_length(self, steps: int | None, done: int) -> None:
        """Raise `InputError` if more steps were kept than are asked for, because none are thrown away."""
        if steps is not None and done > steps:
            raise InputError(
                "more-steps-kept",
                f"{done:,} steps were kept already, and {steps:,} are asked for.",
                place=str(self.file),
                cause="steps count from the beginning, those of before included.",
                fix=f"ask for at least {done:,}, or sample without --resume.",
            )


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
    """Raises one of `DAMAGE` if it is damaged."""
    with opened_hdf5(image) as own:
        words: dict[str, Any] = dict(own.file.attrs)
        if words.get("format") != FORMAT:
            raise ValueError(f"format {words.get('format')}, not {FORMAT}")
        arrays = {name: own.array(name) for name in ARRAYS}
    if digest(*arrays.values()) != words["checksum"]:
        raise ValueError("its checksum does not agree")
    keys, (place, has_gauss, gauss) = arrays.pop("random_keys"), arrays.pop("random_rest")
    random = ("MT19937", keys, int(place), int(has_gauss), float(gauss))
    return History(**arrays, random=random), words
