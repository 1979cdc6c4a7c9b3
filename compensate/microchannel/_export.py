"""Export of a force estimator to a file that runs without JAX."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hysteresis import AbstractModel, InputError, Series
from hysteresis.networks import StaircaseNetwork

from ..export._document import write
from ..export._export import DEEP, Quantity, deepest, has_rates, longest_step
from ..export._precision import require_double
from ..export._trees import nodes_of, tree_of
from ..runtime._file import SCHEMA, number
from ..runtime._network import KIND
from ._everett_network import EverettNetwork
from ._force import BackwardsModel, ForceEstimator

GOLDEN = 200
"""Samples that a file is checked with when it is loaded."""

READING, FORCE = Quantity("reading"), Quantity("force", "N")


def export_force(
    estimator: ForceEstimator, path: str | Path, readings: ArrayLike, *, times: ArrayLike | None = None,
    channels: Sequence[Quantity] = (READING,), estimate: Quantity = FORCE, title: str = "",
) -> Path:  # fmt: skip
    """Write an estimator as JSON for `compensate.runtime.load`, with readings to verify it on loading.

    **Arguments:**

    - `estimator`: of a `StaircaseNetwork`, an `EverettNetwork`, or a chain of models that `invert` takes.
    - `readings`: (samples,), or (samples, channels), typical of its use. The file keeps the first of them
      with their forces, and its Preisach memory is as deep as they need.

    **Other arguments:**

    - `times` (samples,): of the readings, s.
    - `channels`: name and unit of each channel; `estimate`: of the force.
    - `title`: a description in one line.

    **Returns:** the path of the file.

    **Raises:** `InputError` for a model that cannot be exported, fewer than two finite readings, missing
    times where the model needs them, another number of names than of channels, and JAX in single
    precision.

    **Example:**

        >>> y = model.simulate(t, u)
        >>> file = compensate.microchannel.export_force(estimator, folder / "force.json", y)
        >>> compensate.runtime.load(file).high
        6.0
    """
    require_double()
    y = np.asarray(readings, float)
    count = 1 if y.ndim == 1 else y.shape[1]
    if len(channels) != count:
        raise InputError(
            "wrong-channels", f"readings of {count} channels and {len(channels)} names.",
            fix="channels=[Quantity(name, unit), ...], one for each.",
        )  # fmt: skip
    sound = np.isfinite(y.reshape(len(y), -1)).all(1)
    if sound.sum() < 2:
        raise InputError("no-rows", "there are no readings to export for.")
    y, t = y[sound], None if times is None else np.asarray(times, float)[sound]
    model, rates = _program(estimator.model, t, y)
    if rates and t is None:
        raise InputError(
            "no-time", "this model depends on the rate, and no times were given.",
            fix="give the times of the readings.",
        )  # fmt: skip
    t = np.zeros(len(y)) if t is None else t
    longest = longest_step(t) if rates else None
    t, y = t[:GOLDEN], y[:GOLDEN]
    found = estimator.simulate(t, y)
    ends = (estimator.low_reading, estimator.high_reading)
    limits = zip(*(np.broadcast_to(np.asarray(end, float), (count,)) for end in ends), strict=True)
    document = {
        "schema": SCHEMA, "kind": KIND, "title": title or type(estimator.model).__name__,
        "channels": [channel._asdict() for channel in channels], "estimate": estimate._asdict(),
        "limits": [[number(low), number(high)] for low, high in limits],
        "high": estimator.high, "scale": estimator.newtons,
        "deviation": float(estimator.deviation), "rates": rates,
        "longest": longest,
        "model": model,
        "golden": {
            "dt": np.diff(t, prepend=t[0]).tolist(), "reading": y.tolist(),
            "value": np.asarray(found.value).tolist(), "status": np.asarray(found.status).tolist(),
            "tolerance": 1e-9 * estimator.high,
        },
    }  # fmt: skip
    return write(path, document)


def _program(
    model: AbstractModel, t: np.ndarray | None, y: np.ndarray
) -> tuple[dict[str, Any], bool]:
    """The model as plain numbers, and whether it needs times."""
    if isinstance(model, StaircaseNetwork):
        return network_document(model), bool(model.times)
    if y.ndim > 1:
        raise InputError(
            "not-exportable", f"a {type(model).__name__} of several channels cannot be exported.",
            fix="train a network.",
        )  # fmt: skip
    backwards = isinstance(model, BackwardsModel)
    chain = _behind(model.compensator) if backwards else _unfolded(model)
    dt = np.zeros(len(y)) if t is None else np.diff(t, prepend=t[0])
    way = "find" if backwards else "move"

    # Nothing is inverted here: what runs backwards has its inverse, and forwards a reading may fall.
    depth = deepest(tree_of(chain, depth=DEEP), way, dt.tolist(), y.tolist())
    # A quarter more than these readings needed, and never less than compensators have.
    tree = tree_of(chain, depth=max(64, depth + depth // 4))
    return {"kind": "tree", "way": way, "tree": tree}, any(map(has_rates, nodes_of(tree)))


def _unfolded(model: AbstractModel) -> AbstractModel:
    """The chain of models that make up a network, nested chains flattened."""
    if isinstance(model, EverettNetwork):
        return model.model
    return Series([_unfolded(part) for part in model.parts]) if isinstance(model, Series) else model


def _behind(compensator: Any) -> AbstractModel:
    """The model of which a compensator is the inverse."""
    if not isinstance(getattr(compensator, "model", None), AbstractModel):
        raise InputError(
            "not-exportable", f"a {type(compensator).__name__} cannot be exported.",
            fix="use the estimator itself, or train a network.",
        )  # fmt: skip
    return compensator.model


def network_document(model: StaircaseNetwork) -> dict[str, Any]:
    """Layers that take x as it is and give y: what scales them is put into the first and the last."""
    W = [np.asarray(matrix, float) for matrix in model.matrices]
    b = [np.asarray(bias, float) for bias in model.biases]
    centre, spread = np.asarray(model.centre), np.asarray(model.spread)
    W[0] = W[0] / spread[:-1]
    b[0] = b[0] - W[0] @ centre[:-1]
    W[-1], b[-1] = spread[-1] * W[-1], centre[-1] + spread[-1] * b[-1]
    return {
        "kind": "network", "matrices": [matrix.tolist() for matrix in W],
        "biases": [bias.tolist() for bias in b],
        "thresholds": list(model.thresholds), "times": list(model.times),
        "rest": list(model.rest), "scale": list(model.scale),
    }  # fmt: skip
