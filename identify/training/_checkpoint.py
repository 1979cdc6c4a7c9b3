"""What a checkpoint of a training run holds, and which run it belongs to."""

from importlib.metadata import version
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..storage._checkpoint import Work, digest

TRAINING = Work(
    "epochs", "the network was trained", "epochs", "make room, then train again with resume=True.",
    "train from the beginning, without resume.",
)  # fmt: skip


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


def kept_arrays(run: Any) -> dict[str, np.ndarray]:
    """The leaves of a run's state as a checkpoint keeps them."""
    return {f"leaf{k}": np.asarray(leaf) for k, leaf in enumerate(jax.tree.leaves(run))}


def kept_run(arrays: dict[str, np.ndarray] | None, like: Any) -> Any:
    """The inverse, in the structure of `like`; `like` itself where nothing was kept."""
    if arrays is None:
        return like
    leaves = [jnp.asarray(arrays[f"leaf{k}"]) for k in range(len(arrays))]
    return jax.tree.unflatten(jax.tree.structure(like), leaves)
