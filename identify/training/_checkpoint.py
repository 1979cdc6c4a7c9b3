"""Checkpoints of a training run: an .npz without pickles, refused if it belongs to another run."""

import io
import json
from importlib.metadata import version
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import numpy as np

from hysteresis._limits import damage_told, load_arrays, parse_json

from ..storage._checkpoint_file import CheckpointFile, check_identity, digest

FORMAT = 1


def training_identity(
    module: Any, data: Any, held_out: Any, loss: Any, **settings: Any
) -> dict[str, str]:
    """What must be the same for a run to resume bit for bit: a digest or a few words each."""
    # Names and values of the weights: the repr of a tree holds addresses of functions, which differ from
    # one process to the next.
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
    """The checkpoint of a training run, see `CheckpointFile`.

    - `file`: its name; None keeps nothing. `identity`: which run it belongs to.
    - `said`: notes for the user about what was read.
    """

    def __init__(self, file: Path | None, identity: dict[str, str]):
        self.file, self.identity = file, identity
        self.said: list[str] = []
        self._kept = CheckpointFile(file)

    def is_due(self, since: float) -> bool:
        """Whether to write again, `since` seconds after the last write."""
        return self._kept.is_due(since)

    def write(self, run: Any) -> None:
        """Keep the run. Raises `InputError` if it cannot be written; the old file stays."""
        if self.file is None:
            return
        leaves = [np.asarray(leaf) for leaf in jax.tree.leaves(run)]
        words = {**self.identity, "format": FORMAT, "checksum": digest(*leaves)}
        arrays = {f"leaf{k}": leaf for k, leaf in enumerate(leaves)}
        packed = io.BytesIO()
        np.savez(packed, words=np.array(json.dumps(words)), **arrays)  # type: ignore[arg-type]
        self._kept.write(
            packed.getvalue(), "the training", fix="make room, then train again with resume=True."
        )

    def read(self, like: Any) -> Any:
        """The run that was kept, in the structure of `like`; `like` itself if nothing was kept yet.

        Raises `InputError` if the file belongs to another run, or cannot be read.
        """
        assert self.file is not None
        if not self.file.exists():
            self.said.append(
                f"nothing was kept in {self.file.name}, so training began from the start."
            )
            return like
        leaves, structure = jax.tree.flatten(like)
        with damage_told("the checkpoint", self.file, "train from the beginning, without resume."):
            found = load_arrays(self.file)
            words = parse_json(str(found["words"]))
            kept = [found[f"leaf{k}"] for k in range(len(found) - 1)]
            if words.get("format") != FORMAT or words.get("checksum") != digest(*kept):
                raise ValueError("its checksum does not agree")
        check_identity(
            self.file, {**self.identity, "number of arrays": str(len(leaves))},
            {**words, "number of arrays": str(len(kept))}, verb="the network was trained",
            fix="give the data and settings of then, or another file, or train without resume.",
        )  # fmt: skip
        self.said.append(f"resumed from {self.file.name}.")
        return jax.tree.unflatten(structure, kept)
