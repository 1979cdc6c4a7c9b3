"""Training of networks: epochs of shuffled batches in one compiled loop, with early stopping."""

import time
from collections.abc import Callable
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float, Int, PRNGKeyArray

from hysteresis import InputError
from hysteresis._parameter import is_concrete

from ..parameters._settings import require_double
from ..storage._checkpoint import Checkpoint, Work, digest

ROUNDS = 6


def shuffled(key: PRNGKeyArray, rows: int) -> Int[Array, " rows"]:
    """The integers 0, 1, ... rows-1 in a random order, for the batches of an epoch.

    A Feistel network is a bijection of the integers of 2 h bits, for any round function:

        (l, r) <- (r, l xor hash(r, key_n) mod 2^h),     n = 1, ..., 6

    Its values below `rows` are kept. `jax.random.permutation` sorts twice, which took 38 of the 60 ms of an
    epoch of 797 batches; this takes 2 ms. It reaches only some of the rows! orders, but both orders of any
    two rows are equally likely: enough to mix batches, not for cryptography.
    """
    half = max(1, ((rows - 1).bit_length() + 1) // 2)
    mask = jnp.uint32(2**half - 1)
    every = jnp.arange(4**half, dtype=jnp.uint32)
    left, right = every >> half, every & mask
    for round_key in jax.random.bits(key, (ROUNDS,), jnp.uint32):
        left, right = right, left ^ (_hash(right + round_key) & mask)
    value = (left << half) | right
    kept = value < rows
    place = jnp.where(kept, jnp.cumsum(kept, dtype=jnp.int32) - 1, rows)
    return jnp.zeros(rows, jnp.int32).at[place].set(value.astype(jnp.int32), mode="drop")


def _hash(x: Array) -> Array:
    """The finaliser of MurmurHash3: every bit of x changes each bit of it half the time."""
    x = (x ^ (x >> 16)) * jnp.uint32(0x85EBCA6B)
    x = (x ^ (x >> 13)) * jnp.uint32(0xC2B2AE35)
    return x ^ (x >> 16)


TRAINING = Work(
    "epochs", "the network was trained", "epochs", "make room, then train again with resume=True.",
    "train from the beginning, without resume but with --overwrite.",
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


Loss = Callable[[Any, Any, PRNGKeyArray], Float[Array, ""]]
Tell = Callable[[int, int, str], None]

CHUNK_S = 1.0
"""Seconds of compiled epochs between two checks of the clock, the checkpoint and Ctrl-C."""


class Trained(NamedTuple):
    """A trained network with its best weights, and its learning curves.

    - `module`: of the type that was given. `best`: the epoch whose weights it has, counted from 0.
    - `train`, `validation` (epochs run,): the mean loss over each epoch's batches during training, and of
      the validation rows after the epoch; NaN if there are none.
    - `stopped`: why: `"epochs"` if all were run, `"patience"`, or `"diverged"`.
    - `seconds`: of this call. `said`: notes for the user about the checkpoint.
    """

    module: Any
    train: Float[np.ndarray, " epochs"]
    validation: Float[np.ndarray, " epochs"]
    best: int
    stopped: str
    seconds: float
    said: tuple[str, ...] = ()


class _Run(NamedTuple):
    """The state that an epoch changes. The weights are one vector, so an update is one operation of XLA.

    Updating sixteen small arrays one by one costs as much as the gradient: a step of the paper's network
    then takes 172 microseconds instead of 86.
    """

    weights: Float[Array, " weights"]
    optimizer: Any
    best: Float[Array, " weights"]
    least: Float[Array, ""]
    best_epoch: Array
    epoch: Array
    curves: Float[Array, "2 epochs"]


def train(
    module: eqx.Module,
    loss: Loss,
    data: Any,
    *,
    validation: Any = 0.1,
    batch: int = 64,
    epochs: int = 1000,
    patience: int | None = None,
    learning_rate: float = 1e-3,
    optimizer: optax.GradientTransformation | None = None,
    seed: int = 0,
    float32: bool = False,
    checkpoint: Path | None = None,
    resume: bool = False,
    progress: Tell | None = None,
) -> Trained:
    """Minimise the mean of a loss over rows of data by stochastic gradient descent; keep the best weights.

        w <- w - step(d/dw loss(module_w, rows of one batch, key)),      batches shuffled in every epoch

    Every floating array of the module is a weight; a constant must be a Python float. Epoch k draws its
    order and noise from (`seed`, k) alone, so a run that was stopped and resumed ends with the same bits
    as one that was not.

    **Arguments:**

    - `module`: the network to start from.
    - `loss`: function of (module, rows, key); returns the mean loss over these rows. `key` is for dropout.
      On validation rows the network is in `eqx.nn.inference_mode`.
    - `data`: arrays in any tree; their first axis is the rows.

    **Other arguments:**

    - `validation`: fraction of the rows to hold out, drawn by `seed`; or other data in the structure of
      `data`, which is the right choice for sequences, because neighbouring rows resemble each other. The
      weights with the lowest validation loss are kept; with 0, those with the lowest training loss.
    - `batch`: rows a step; rows at the end of an epoch that do not fill a batch are skipped.
    - `epochs`: the most to run. `patience`: stop after so many epochs without a new minimum; None never
      does.
    - `learning_rate`: of Adam. `optimizer`: another optimiser of optax, used instead of Adam.
    - `seed`: of the held-out rows, the batches and the dropout.
    - `float32`: train in single precision, which halves the time; the result keeps its precision.
    - `checkpoint`: an .npz that keeps the run, written every ten seconds, at Ctrl-C and at the end.
      `resume`: continue the run that it holds.
    - `progress`: called with (epochs done, epochs, words) now and then.

    Returns the trained network and its learning curves.

    Raises `InputError` for data without rows, of unlike lengths or not finite, settings out of range, a
    loss that is never finite (`diverged`), a checkpoint of another run (`other-checkpoint`), and if double
    precision is off without `float32`.

    Source: Kim and Park (2018), section III A: Adam, batches of 64, 1,000 epochs, a tenth to validate.

    In the example: a line, learnt from 64 points.
    """
    since = time.perf_counter()
    require_double(float32)
    _check_settings(batch, epochs, patience, learning_rate)
    count = _rows(data, "data")
    if checkpoint is None and resume:
        said = "resume=True needs a checkpoint to resume."
        raise InputError("no-checkpoint", said, fix="give checkpoint=FILE.")
    precision = jnp.float32 if float32 else None
    weights, rest = eqx.partition(module, eqx.is_inexact_array)
    if not jax.tree.leaves(weights):
        raise InputError("nothing-free", f"{type(module).__name__} has no floating array to train.")
    start, template = ravel_pytree(_cast(weights, precision))[0], _cast(weights, precision)
    data, held_out = _split(data, validation, count, seed)
    data, held_out = _cast(data, precision), _cast(held_out, precision)
    batch = min(batch, _rows(data, "data"))
    optimizer = optimizer or _adam(learning_rate)

    run = _Run(
        start, optimizer.init(start), start, jnp.asarray(jnp.inf, start.dtype),
        jnp.asarray(0), jnp.asarray(0), jnp.full((2, epochs), jnp.nan, start.dtype),
    )  # fmt: skip
    identity = training_identity(
        module, data, held_out, loss, batch=batch, seed=seed, optimizer=run.optimizer,
        learning_rate=learning_rate,
    )  # fmt: skip
    file = Checkpoint(checkpoint, identity, resume, work=TRAINING)
    if resume:
        if (kept := file.read()) is not None and checkpoint is not None:
            file.said.append(f"resumed from {checkpoint.name}.")
        if kept is not None:
            leaves = [jnp.asarray(kept[f"leaf{k}"]) for k in range(len(kept))]
            run = jax.tree.unflatten(jax.tree.structure(run), leaves)
        done = int(run.epoch)
        file.check_length(epochs, done)
        # A run may be resumed for more epochs than before.
        room = jnp.full((2, epochs), jnp.nan, run.curves.dtype)
        run = run._replace(curves=room.at[:, :done].set(run.curves[:, :done]))
    problem = (template, rest, data, held_out, jax.random.key(seed))
    settings = (loss, optimizer, batch, epochs if patience is None else patience)

    tell, chunk, saved = progress or (lambda *_: None), 1, time.monotonic()
    pending = run
    try:
        while not _is_over(run, epochs, settings[-1]):
            begin = time.perf_counter()
            before = int(run.epoch)
            pending = _epochs(run, jnp.asarray(before + chunk), problem, settings)
            run = jax.block_until_ready(pending)
            spent = time.perf_counter() - begin
            # The first chunk includes compilation, so its time is no guide: the second is one epoch again.
            chunk = chunk if before == 0 else max(1, int(chunk * min(10, CHUNK_S / spent)))
            if file.is_due(time.monotonic() - saved):
                file.write(kept_arrays(run), int(run.epoch))
                saved = time.monotonic()
            tell(int(run.epoch), epochs, _words(run))
    except KeyboardInterrupt:
        # Wait: a process that exits while a chunk is computed crashes.
        run = jax.block_until_ready(pending)
        file.write(kept_arrays(run), int(run.epoch))
        raise
    file.write(kept_arrays(run), int(run.epoch))
    done = int(run.epoch)
    seen, judged = np.asarray(run.curves, float)[:, :done]
    if not np.isfinite(float(run.least)):
        raise InputError(
            "diverged",
            "the loss was not finite after the first epoch.",
            cause="too large a step, or inputs or outputs of a size far from 1.",
            fix="scale the data, or give a smaller learning_rate.",
        )
    stopped = "epochs" if done == epochs else "patience"
    stopped = "diverged" if not np.isfinite(seen[-1]) else stopped
    best = ravel_pytree(template)[1](run.best)
    best = jax.tree.map(lambda new, old: new.astype(old.dtype), best, weights)
    return Trained(
        eqx.combine(best, rest), seen, judged, int(run.best_epoch), stopped,
        time.perf_counter() - since, tuple(file.said),
    )  # fmt: skip


@cache
def _adam(learning_rate: float) -> optax.GradientTransformation:
    """Cached, because the loop is compiled for one optimiser object."""
    return optax.adam(learning_rate)


@eqx.filter_jit
def _epochs(run: _Run, until: Array, problem: Any, settings: Any) -> _Run:
    """Epochs up to `until`, in a loop whose length is not compiled in; each is a scan over its batches."""
    template, rest, data, held_out, key = problem
    loss, optimizer, batch, patience = settings
    unravel = ravel_pytree(template)[1]
    rows = _rows(data, "data")
    batches, epochs = rows // batch, run.curves.shape[1]

    def of(weights: Array, some: Any, noise: Any, learns: bool) -> Array:
        module = eqx.combine(unravel(weights), rest)
        return loss(module if learns else eqx.nn.inference_mode(module), some, noise)

    def step(carry: Any, now: Any) -> Any:
        weights, state = carry
        some, noise = now
        value, gradient = jax.value_and_grad(of)(weights, some, noise, True)
        with jax.numpy_dtype_promotion("standard"):  # optax's powers mix floats and integers
            update, state = optimizer.update(gradient, state, weights)
        return (optax.apply_updates(weights, update), state), value

    def epoch(run: _Run) -> _Run:
        shuffle, noise, last = jax.random.split(jax.random.fold_in(key, run.epoch), 3)
        order = shuffled(shuffle, rows)[: batches * batch].reshape(batches, batch)
        ordered = jax.tree.map(lambda leaf: leaf[order], data)
        carry = run.weights, run.optimizer
        noises = jax.random.split(noise, batches)
        (weights, state), losses = jax.lax.scan(step, carry, (ordered, noises))
        seen = losses.mean()
        judged = seen if held_out is None else of(weights, held_out, last, False)
        better = judged < run.least
        curve = jnp.stack([seen, jnp.nan * seen if held_out is None else judged])
        return _Run(
            weights, state,
            jnp.where(better, weights, run.best), jnp.where(better, judged, run.least),
            jnp.where(better, run.epoch, run.best_epoch), run.epoch + 1,
            run.curves.at[:, run.epoch].set(curve),
        )  # fmt: skip

    def goes_on(run: _Run) -> Array:
        return (run.epoch < until) & ~_is_over(run, epochs, patience)

    return jax.lax.while_loop(goes_on, epoch, run)


def _is_over(run: _Run, epochs: int, patience: Any) -> Array:
    waited = run.epoch - run.best_epoch > patience
    diverged = (run.epoch > 0) & ~jnp.isfinite(run.curves[0, jnp.maximum(run.epoch - 1, 0)])
    return (run.epoch >= epochs) | waited | diverged


def _words(run: _Run) -> str:
    last = float(run.curves[0, int(run.epoch) - 1])
    return f"loss {last:.3g}, least {float(run.least):.3g} after epoch {int(run.best_epoch) + 1}"


def _split(data: Any, validation: Any, count: int, seed: int) -> tuple[Any, Any]:
    if not isinstance(validation, int | float):
        _rows(validation, "validation")
        if jax.tree.structure(validation) != jax.tree.structure(data):
            raise InputError("wrong-shape", "validation does not have the structure of data.")
        return data, validation
    if not 0 <= validation < 1:
        raise InputError(
            "bad-option", f"validation = {validation:g} is not a fraction of the rows."
        )
    held = round(validation * count)
    if not held:
        return data, None
    if held == count:
        raise InputError("too-few-rows", f"{count} rows leave none to train on.")
    order = np.random.default_rng(seed).permutation(count)
    own, other = (
        jax.tree.map(lambda leaf, at=at: jnp.asarray(leaf)[at], data)
        for at in (np.sort(order[held:]), np.sort(order[:held]))
    )
    return own, other


def _cast(tree: Any, precision: Any) -> Any:
    def cast(leaf: Any) -> Array:
        leaf = jnp.asarray(leaf)
        floating = precision is not None and jnp.issubdtype(leaf.dtype, jnp.floating)
        return leaf.astype(precision) if floating else leaf

    return jax.tree.map(cast, tree)


def _rows(data: Any, name: str) -> int:
    """The number of rows. Raises `InputError` if the arrays differ in length or hold non-finite entries."""
    leaves = jax.tree.leaves(data)
    lengths = {np.shape(leaf)[0] if np.ndim(leaf) else 0 for leaf in leaves}
    if len(lengths) != 1 or 0 in lengths:
        said = f"{name} consists of arrays with {sorted(lengths)} rows."
        raise InputError("length-mismatch", said, fix="give arrays of one length, at least 1.")
    for leaf in leaves:
        known = is_concrete(leaf) and np.issubdtype(leaf.dtype, np.floating)
        if known and not np.isfinite(np.asarray(leaf)).all():
            said = f"{name} has entries that are not finite."
            raise InputError("not-finite", said, fix="exclude those rows.")
    return lengths.pop()


def _check_settings(batch: int, epochs: int, patience: int | None, learning_rate: float) -> None:
    least = {"batch": batch, "epochs": epochs, "patience": 1 if patience is None else patience}
    for name, value in least.items():
        if value < 1:
            raise InputError("bad-option", f"{name} = {value} is less than 1.")
    if not 0 < learning_rate < float("inf"):
        raise InputError("bad-option", f"learning_rate = {learning_rate:g} is not above 0.")
