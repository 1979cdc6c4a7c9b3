"""A training run kept on disk: an .npz without pickles, refused where it belongs to another run."""

import io
import json
import os
from importlib.metadata import version
from pathlib import Path
from time import perf_counter
from typing import Any
from zipfile import BadZipFile

import equinox as eqx
import jax
import numpy as np

from hysteresis import InputError

from ..storage._checkpoint import AT_MOST, digest

FORMAT = 1
EVERY_S = 10.0


def training_identity(
    module: Any, data: Any, held_out: Any, loss: Any, **settings: Any
) -> dict[str, str]:
    """What has to be the same for a run to go on bit for bit, each a digest or a few words."""
    # Names and values of the weights: what a tree's own text says of functions changes with every start.
    weights = jax.tree.leaves_with_path(eqx.filter(module, eqx.is_array))
    name = f"{loss.__module__}.{loss.__qualname__}" if hasattr(loss, "__qualname__") else ""
    optimizer = jax.tree.structure(settings.pop("optimizer"))
    return {
        "network": digest(
            *(part for path, w in weights for part in (jax.tree_util.keystr(path), np.asarray(w)))
        ),
        "data": digest(*map(np.asarray, jax.tree.leaves((data, held_out)))),
        "loss": name or type(loss).__name__,
        "optimizer": digest(str(optimizer)),
        "versions": " ".join(f"{name} {version(name)}" for name in ("jax", "optax")),
        **{key: str(value) for key, value in settings.items()},
    }


class TrainingFile:
    """The file of a run: written to a new one, synced, then given the name, so that one is always whole.

    - `file`: its name; None keeps nothing. `identity`: what the run belongs to.
    - `said`: what to tell the user of its reading.
    """

    def __init__(self, file: Path | None, identity: dict[str, str]):
        self.file, self.identity = file, identity
        self.said: list[str] = []
        self._cost = 0.0

    def is_due(self, since: float) -> bool:
        """Whether to write again, `since` seconds after the last time."""
        return since >= max(EVERY_S, self._cost / AT_MOST)

    def write(self, run: Any) -> None:
        """Keep the run. Raises `InputError` where the disk does not take it; what was there stays."""
        if self.file is None:
            return
        begin, new = perf_counter(), self.file.with_suffix(f".new{self.file.suffix}")
        leaves = [np.asarray(leaf) for leaf in jax.tree.leaves(run)]
        words = {**self.identity, "format": FORMAT, "checksum": digest(*leaves)}
        arrays = {f"leaf{k}": leaf for k, leaf in enumerate(leaves)}
        try:
            with new.open("wb") as handle:
                np.savez(handle, words=np.array(json.dumps(words)), **arrays)  # type: ignore[arg-type]
                handle.flush()
                os.fsync(handle.fileno())
            os.replace(new, self.file)
        except OSError as error:
            new.unlink(missing_ok=True)
            raise InputError(
                "cannot-write",
                f"the training cannot be kept: {error.strerror or error}.",
                place=str(self.file),
                cause="the disk or a quota is full, or the folder may not be written to.",
                fix="make room, then train again with resume=True.",
            ) from error
        self._cost = perf_counter() - begin

    def read(self, like: Any) -> Any:
        """The run that was kept, in the shape of `like`; `like` itself where nothing was kept yet.

        Raises `InputError` where the file belongs to something else, or cannot be read.
        """
        assert self.file is not None
        if not self.file.exists():
            self.said.append(f"nothing was kept in {self.file.name}: trained from the beginning.")
            return like
        leaves, structure = jax.tree.flatten(like)
        try:
            with np.load(io.BytesIO(self.file.read_bytes()), allow_pickle=False) as found:
                words = json.loads(str(found["words"]))
                kept = [found[f"leaf{k}"] for k in range(len(found.files) - 1)]
            if words.get("format") != FORMAT or words.get("checksum") != digest(*kept):
                raise ValueError("its checksum does not agree")
        except (OSError, KeyError, ValueError, EOFError, BadZipFile) as error:
            raise InputError(
                "damaged-file",
                f"the checkpoint cannot be read: {error}.",
                place=str(self.file),
                cause="it was cut off or changed, or another version wrote it.",
                fix="train from the beginning, without resume.",
            ) from error
        other = [name for name, own in self.identity.items() if words.get(name) != own]
        if other or len(kept) != len(leaves):
            raise InputError(
                "other-checkpoint",
                f"the checkpoint is of a training with another {', another '.join(other)}.",
                place=str(self.file),
                cause="the data or the settings have changed since.",
                fix="give those of then, or another file, or train without resume.",
            )
        self.said.append(f"gone on from {self.file.name}.")
        return jax.tree.unflatten(structure, kept)
