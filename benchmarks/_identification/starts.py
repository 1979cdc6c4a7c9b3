"""How long a search from many starts takes side by side, beside the same starts one after another.

Both run the same compiled Levenberg-Marquardt. Alone every start goes on to its end, 40 steps at most; side
by side all take a few steps and the best go on, see `multi_start`.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from hysteresis import Burgers, Record
from identify.parameters._transform import transform_for
from identify.parametric._multistart import (
    arguments_of,
    levenberg_marquardt,
    mean_squared_error,
    multi_start,
)
from identify.records._run_model import prepare

from .._measure import Row, interleaved, judged

SAMPLES, STARTS, STEPS, SPREAD = 1000, 64, 40, 1.5


def start_rows(quick: bool) -> list[Row]:
    """64 starts of a Burgers element, and whether the best of them is as good."""
    t = np.linspace(0, 60, SAMPLES)
    u = np.interp(t, np.linspace(0, 60, 13), [0, 5, 5, 5, 1, 1, 3, 3, 0.5, 4, 4, 2, 0])
    truth, random = Burgers(2.0, 100.0, 1.0, 8.0, 0.3), np.random.default_rng(0)
    y = np.asarray(truth.simulate(t, u))
    record = Record.from_arrays(u, y + random.normal(0, 0.02 * np.ptp(y), SAMPLES), t)
    bounds, prepared = transform_for(truth, record).for_fit, prepare(truth, record)
    about = bounds.to_free(truth)
    points = about + SPREAD * random.normal(size=(STARTS, len(about)))
    y, alone = record.output, [jnp.asarray(point) for point in points]
    arguments = arguments_of(truth, prepared, y, record.mask)

    def side_by_side() -> float:
        found = multi_start(bounds, truth, prepared, y, record.mask, points)
        return float(found.objective[0])

    @eqx.filter_jit
    def objective_from(arguments: Any, point: jax.Array) -> jax.Array:
        end = levenberg_marquardt(bounds, arguments, point, STEPS, 1e-6).value
        return mean_squared_error(bounds, end, arguments)

    def one_after_another() -> float:
        return min(float(objective_from(arguments, point)) for point in alone)

    calls = {"mapped": side_by_side, "alone": one_after_another}
    seconds = {k: taken.min() for k, taken in interleaved(calls, 5 if quick else 15).items()}
    what = f"{STARTS} starts of Burgers, {SAMPLES} samples: side by side over one after another"
    same = f"{what.split(':')[0]}: best objective over that of one after another"
    return [
        judged(what, seconds["mapped"] / seconds["alone"], 0.5),
        judged(same, side_by_side() / one_after_another(), 1.001),
    ]
