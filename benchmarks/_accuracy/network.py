"""A recurrent network of eight cells as a rival: 320 parameters where there is one input.

    h <- GRU(h, x),   output h_1,   x = input, its first and second difference, logarithm of the time step

It is trained on the same rows as our fits, in windows; where the output is known h_1 is set to it (warm
start): over the first rows of windows in the middle of a sequence, and over rows before those to predict.
Three networks of other seeds are trained side by side, and the mean of their errors is what counts. A
minute of training a set is too slow for every run of the table: `networks.json` keeps the figures.

Source: the smallest of the networks of RHINO-MAG (github.com/upb-lea/RHINO-MAG), for ferrites.
"""

import json
import time
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax

from hysteresis import Record
from identify.training._train import train

FROZEN = Path(__file__).with_name("networks.json")
CELLS, SEEDS = 8, (0, 1, 2)
WINDOW, TOLD, BATCH = 400, 80, 32
"""Rows of a window, rows at its beginning that are known, and windows a step."""
STEPS, RATE = 2000, 1e-2
"""Of a row of the table, shared by its fits; the first step's size, which falls to 0."""
ROWS = 20_000
"""At most, of the training rows: of longer records every second, third ... is taken."""
SPARE = 0.8
"""The largest output, in parts of what a cell can have."""

Windows = dict[str, np.ndarray]


class Networks(eqx.Module):
    """Gated recurrent units, one network of each seed: the seeds are the leading axis of all arrays.

    - `inward`, `inner`: weights of the inputs and of the cells, of the reset, update and new gates.
    - `offsets` of these, and `own` of the cells in the new one.
    """

    inward: Any
    inner: Any
    offsets: Any
    own: Any

    def __init__(self, inputs: int) -> None:
        cells = [eqx.nn.GRUCell(inputs, CELLS, key=jax.random.key(seed)) for seed in SEEDS]
        fields = ("weight_ih", "weight_hh", "bias", "bias_n")
        each = ([getattr(cell, name) for cell in cells] for name in fields)
        self.inward, self.inner, self.offsets, self.own = map(jnp.stack, each)

    def outputs(self, x: Any, y: Any, told: Any) -> Any:
        """(rows, seeds, batch) at inputs (rows, batch, inputs), with the known outputs where `told`."""
        felt = jnp.einsum("sgi,tbi->tsbg", self.inward, x) + self.offsets[:, None]

        def step(h: Any, now: Any) -> Any:
            felt, y, told = now
            inner = jnp.einsum("sgh,sbh->sbg", self.inner, h)
            reset, update = jnp.split(jax.nn.sigmoid(felt + inner)[..., : 2 * CELLS], 2, -1)
            more = inner[..., 2 * CELLS :] + self.own[:, None]
            new = jnp.tanh(felt[..., 2 * CELLS :] + reset * more)
            h = new + update * (h - new)
            return h.at[..., 0].set(jnp.where(told, y, h[..., 0])), h[..., 0]

        first = jnp.zeros((len(SEEDS), x.shape[1], CELLS), felt.dtype)
        return jax.lax.scan(step, first, (felt, y, told))[1]


def _loss(networks: Any, windows: Any, _: Any) -> Any:
    x, y, told, weight = (jnp.swapaxes(windows[k], 0, 1) for k in ("x", "y", "told", "weight"))
    off = networks.outputs(x, y, told) - y[:, None]
    return (weight[:, None] * off**2).sum() / weight.sum()


@eqx.filter_jit
def _run(networks: Networks, x: Any, y: Any, told: Any) -> Any:
    return networks.outputs(x[:, None], y[:, None], told[:, None])[..., 0].T


def predictions(record: Record, test: Record | None, steps: int = STEPS) -> tuple[np.ndarray, int]:
    """Of the test record, (seeds, rows), of the training record without one; and how many parameters a
    network has."""
    tested = record if test is None else test
    goes_on = test is not None and np.array_equal(record.line, test.line)
    told = record.mask if goes_on else _known(tested)
    every = max(1, int(record.mask.sum()) // ROWS)
    scales = _Scales(record, every)
    windows = _windows(record, scales, every, goes_on or bool(told.any()))
    epochs = -(-steps // max(1, len(windows["y"]) // BATCH))
    schedule = optax.cosine_decay_schedule(RATE, steps)
    optimizer = optax.chain(optax.clip_by_global_norm(1.0), optax.adam(schedule))
    trained = train(
        Networks(scales.inputs), _loss, windows, validation=0, batch=BATCH, epochs=epochs,
        optimizer=optimizer, seed=SEEDS[0], float32=True,
    ).module  # fmt: skip
    found = np.empty((len(SEEDS), len(tested)))
    for _, rows in tested.sequences():
        at = _every(rows, every)
        x, y = scales.of(tested, at)
        outputs = np.asarray(_run(trained, x, y, told[at] & np.isfinite(y)))
        for k, one in enumerate(outputs):
            found[k, rows] = np.interp(np.arange(rows.start, rows.stop), at, one)
    count = sum(leaf[0].size for leaf in jax.tree.leaves(eqx.filter(trained, eqx.is_array)))
    return scales.middle + scales.size * found, count


class _Scales:
    """What inputs and outputs are centred and divided by: of the training rows."""

    def __init__(self, record: Record, every: int) -> None:
        self.middle, self.size = 0.0, 1.0
        y = record.output[record.mask]
        self.middle = float(y.max() + y.min()) / 2
        self.size = float(np.ptp(y)) / 2 / SPARE or 1.0
        each = [self._raw(record, _every(rows, every)) for _, rows in record.sequences()]
        x = np.vstack(each)
        self.means, self.deviations = x.mean(0), np.where(x.std(0) > 0, x.std(0), 1.0)
        self.inputs = x.shape[1]

    def of(self, record: Record, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Scaled inputs and outputs at these rows of a sequence."""
        x = (self._raw(record, at) - self.means) / self.deviations
        y = np.nan_to_num((record.output[at] - self.middle) / self.size)
        return x.astype(np.float32), y.astype(np.float32)

    @staticmethod
    def _raw(record: Record, at: np.ndarray) -> np.ndarray:
        channels = [record.columns[name] for name in record.channels] or [record.input]
        held = [record.columns[name][at] for name in record.conditions]
        u = np.column_stack([channel[at] for channel in channels])
        moved = np.diff(u, axis=0, prepend=u[:1])
        dt = np.ones(len(at)) if record.time is None else np.diff(record.time[at], prepend=np.nan)
        clock = np.log(np.where(dt > 0, dt, np.nanmedian(dt)))
        return np.column_stack([u, moved, np.diff(moved, axis=0, prepend=moved[:1]), clock, *held])


def _windows(record: Record, scales: _Scales, every: int, warm: bool) -> Windows:
    longest = max(len(range(rows.start, rows.stop, every)) for _, rows in record.sequences())
    window = min(WINDOW, longest)
    found: dict[str, list[np.ndarray]] = {name: [] for name in ("x", "y", "told", "weight")}
    for _, rows in record.sequences():
        at = _every(rows, every)
        x, y = scales.of(record, at)
        weight = (record.mask & np.isfinite(record.output))[at] * record.weights[at] ** 2
        for begin in range(0, max(len(at) - TOLD, 1), WINDOW - TOLD):
            own = slice(begin, begin + window)
            short = window - len(y[own])
            told = (np.arange(window) < TOLD) & (begin > 0 or warm)
            padded = [
                np.pad(z[own], [(0, short)] + [(0, 0)] * (z.ndim - 1)) for z in (x, y, weight)
            ]
            for name, value in zip(("x", "y", "weight"), padded, strict=True):
                found[name].append(value)
            found["told"].append(told)
            found["weight"][-1] = np.where(told, 0, found["weight"][-1])
    arrays = {name: np.stack(values) for name, values in found.items()}
    some = arrays["weight"].sum(1) > 0
    return {name: array[some] for name, array in arrays.items()}


def _every(rows: slice, every: int) -> np.ndarray:
    return np.arange(rows.start, rows.stop, every)


def _known(record: Record) -> np.ndarray:
    return np.zeros(len(record), bool) if record.known is None else record.known


def frozen() -> dict[str, Any]:
    """The figures of each row of the table that was frozen."""
    return json.loads(FROZEN.read_text()) if FROZEN.exists() else {}


def freeze(what: str, pairs: Any, error: Any) -> dict[str, Any]:
    """Train on each pair of records; keep and return the mean of the `error`s of (record, predicted)."""
    begin, errors, count = time.process_time(), [], 0
    pairs = list(pairs)
    for record, test in pairs:
        found, count = predictions(record, test, STEPS // len(pairs))
        errors.append([error(record if test is None else test, one) for one in found])
    of_seeds = np.mean(errors, 0)
    entry = {
        "error": round(float(of_seeds.mean()), 4), "of seeds": [round(x, 4) for x in of_seeds.tolist()],
        "seeds": list(SEEDS), "parameters": count, "seconds": round(time.process_time() - begin),
    }  # fmt: skip
    kept = frozen() | {what: entry}
    lines = (f"{json.dumps(name)}: {json.dumps(kept[name])}" for name in sorted(kept))
    FROZEN.write_text("{\n" + ",\n".join(lines) + "\n}\n")
    return entry
