"""The modes of a linear system: poles by vector fitting, then Gauss-Newton, their number by held-out lines.

A record that is not a period is one of a system with an input more: its ends differ by one blow at
the first row, which strikes every mode,

    Y = G U + sum of c_m a_m / (s - p_m),     a_m = x_m(0) - x_m(T).

Cost: some twenty steps for each number of modes, and as many without one of them.

Source: Pintelon and Schoukens, System Identification (2012); `_vector_fitting.py`.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from threadpoolctl import threadpool_limits

from hysteresis import Feedback, InputError
from hysteresis.dynamics._feedback import CLOSE

from .._levels import HELD, LITTLE, MUCH
from ._feedback_search import Spectra, gauss_newton, simulated
from ._feedback_unknowns import SLOWEST, Unknowns
from ._measured_motion import LEAST_ROWS
from ._periodic_tests import excited_lines, input_sizes, periodic_test, spectra_of
from ._vector_fitting import vector_fitted

MANY, MOST_MODES = 20, 30
WORTH = 1 - HELD
"""More modes, or a group of channels, have to bring the error of what is held out below this part of it."""

BAND = 0.02, 1.15
"""Poles that are modes: where they lie, in parts of the highest excited frequency."""

LEAST_LINES, FEW = 4, 1000
"""Lines that tell a mode's pole and residue, and so many of many that a step takes."""


# Many small factorisations, as in `spectrum`.
@threadpool_limits.wrap(limits=1, user_api="blas")
def fit_modes(u: ArrayLike, y: ArrayLike, dt: float) -> Feedback:
    """The modes of a linear system, from any record on an even clock: noise, a sweep, blows of a hammer.

        x_m' = poles_m x_m + entries_m u,     y = 2 Re(shapes x) + direct u

    y is read `delay` later. Half of the spectrum's lines are held out while the delay and the number of
    modes are chosen. From periodic tests `fit_feedback` finds hysteresis between them, too.

    - `u`: (rows, inputs). `y`: (rows, outputs). `dt`: time between rows.

    **Returns:** a `Feedback` without channels, in the record's units, of at most 30 modes. Those beyond the
    band of the inputs stand for what lies above it.

    Raises `InputError` `nothing-fits` where no mode is found, `no-excitation`, `too-few-rows`,
    `length-mismatch`, `not-finite`, `constant-input` and `constant-output` for unusable records.

    Source: Gustavsen and Semlyen 1999; ends of a record as smooth terms, Pintelon and Schoukens 2012.

    **Example:**

        >>> truth = hysteresis.Feedback([-0.1 + 1.5j], [[-0.3j]], [[1.0]], [[0.0]])
        >>> u = np.random.default_rng(0).normal(size=(2000, 1))
        >>> complex(identify.fit_modes(u, truth.simulate(u, dt=0.5), dt=0.5).poles[0].round(3))
        (-0.1+1.5j)
    """
    rows = len(np.asarray(u))
    if rows < LEAST_ROWS:
        raise InputError(
            "too-few-rows",
            f"{rows} rows do not show modes.",
            fix=f"measure at least {LEAST_ROWS} rows.",
        )
    raw = spectra_of([periodic_test(u, y, dt, rows)])[0]
    # Half of the lines are held out: without inputs and outputs they are in no sum.
    seen = np.random.default_rng(0).random(raw.lines.count) < 0.5
    at = excited_lines(raw.U)
    at = at[seen[at]]
    if len(at) < LEAST_LINES:
        raise InputError(
            "no-excitation",
            "the inputs have too few frequencies.",
            fix="excite with noise, a multisine or a sweep about the resonances.",
        )
    in_units, data = _struck(raw.weighed(_noise(raw, at, seen)))

    def error(model: Feedback) -> float:
        left, whole = (data.left(y)[:, ~seen] for y in (simulated(model, data).output, 0.0))
        return float(np.hypot(np.linalg.norm(left) / np.linalg.norm(whole), LITTLE))

    part = data._replace(U=data.U * seen[:, None], Y=data.Y * seen[:, None])
    found = chosen_modes(part, at, (data.U[0, at], data.Y[0, at]), error)
    thin = max(1, data.lines.count // FEW)
    found = gauss_newton(found, data, Unknowns(), steps=20, thin=thin).model
    without = found.entries[:, :-1], found.direct[:, :-1]
    return in_units(replace(found, entries=without[0], direct=without[1]))


def _struck(raw: Spectra) -> tuple[Callable[[Feedback], Feedback], Spectra]:
    """`in_own_units` of a record, with the blow of its ends for an input more."""
    in_units, data = in_own_units(raw)
    blow = np.full((1, data.lines.count, 1), data.size.mean())
    return in_units, data._replace(U=np.concatenate([data.U, blow], 2))


def _noise(raw: Spectra, at: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """Root mean square of what many modes, found from the lines `at`, leave of each output in lines that
    were not seen."""
    data = _struck(raw)[1]
    told = data.lines.s[at], data.U[0, at], data.Y[0, at]
    model = modal(*told, MANY, 0.0, data.Y.shape[2], max(1, len(at) // FEW))
    if not len(model.poles):
        return 0 * raw.size
    left = data.left(simulated(model, data).output)[:, ~seen]
    return raw.size * np.sqrt((np.abs(left) ** 2).mean(1))


def chosen_modes(
    data: Spectra, at: np.ndarray, told: tuple[Any, Any], error: Callable[[Feedback], float]
) -> Feedback:
    """Modes of one level, their number and the delay by the `error` of what is held out: errors below what
    a steady state leaves tell nothing. At the lines `at` they are looked for from what is `told`, inputs
    and outputs or ones and responses.

    Raises `InputError` `nothing-fits`.
    """
    s = data.lines.s[at]

    def tried(count: int, delay: float, thin: int = 1) -> tuple[float, Feedback]:
        model = modal(s, *told, count, delay, data.Y.shape[2], thin)
        return (error(model), model) if len(model.poles) else (np.inf, model)

    thin = max(1, len(at) // FEW)
    delays = np.arange(8) * 0.25 * data.lines.dt
    errors = np.array([tried(MANY, d, thin)[0] for d in delays])
    delay = delays[np.argmax(errors <= MUCH * errors.min())]
    # Gauss-Newton tells apart the numbers of modes whose poles err about as little.
    least, best, found = np.inf, 1.0, None  # of no model 1 is left
    seen = {0}
    for count in range(2, MOST_MODES + 1, 2):
        e, model = tried(count, delay)
        least = min(least, e)
        if e > MUCH * least or best < CLOSE or len(model.poles) in seen:
            continue
        seen.add(len(model.poles))
        model = gauss_newton(model, data, Unknowns(), steps=10, thin=thin).model
        if (e := error(model)) < WORTH * best:
            best, found = e, model
    if found is None:
        raise InputError(
            "nothing-fits",
            "no resonance was found in the band of the excitation.",
            fix="excite a band that holds the resonances.",
        )
    # More poles than modes were needed to find them: those that are not worth theirs go.
    while len(found.poles) > 1:
        size = np.linalg.norm(found.shapes, axis=0) * np.linalg.norm(found.entries, axis=1)
        kept = np.arange(len(size)) != np.argmin(size / -found.poles.real)
        fewer = replace(
            found,
            poles=found.poles[kept],
            entries=found.entries[kept],
            shapes=found.shapes[:, kept],
        )
        fewer = gauss_newton(fewer, data, Unknowns(), steps=5, thin=thin).model
        if error(fewer) > max(best, CLOSE) / WORTH:
            break
        found = fewer
    return found


def in_own_units(data: Spectra) -> tuple[Callable[[Feedback], Feedback], Spectra]:
    """The tests in units of their sizes, and what gives a model of those the units of the tests."""
    middle = data.level == np.unique(data.level)[len(np.unique(data.level)) // 2]
    at = excited_lines(data.U)
    u = float(np.sqrt((input_sizes(data.U[middle], data.lines) ** 2).mean()))
    y = data.size[middle][0] / np.sqrt((np.abs(data.U[middle][:, 1:]) ** 2).mean()) * u
    t = 3.0 / float(abs(data.lines.s[at[-1]]))

    def back(model: Feedback) -> Feedback:
        none = np.ones(len(model.channels))
        columns, rows = np.append(np.full(model.inputs, u), none), np.append(y, none)[:, None]
        return Feedback(
            model.poles / t, model.entries / (columns * t), model.shapes * rows,
            model.direct * rows / columns, model.delay * t, model.channels, model.levels, model.memory,
        )  # fmt: skip

    lines = data.lines._replace(dt=data.lines.dt / t)
    return back, Spectra(lines, data.U / u, data.Y / y, data.level, data.size / y)


def modal(
    s: Any, U: Any, Y: Any, count: int, delay: float, outputs: int, thin: int = 1
) -> Feedback:
    """Modes of rank one from inputs U and outputs Y, or from ones and responses (lines, outputs x inputs),
    by so many poles over the band."""
    top = abs(s[-1])
    at = top * np.linspace(abs(s[0]) / top if count < 3 else 0.5 / count, 1.03, count)
    own = s[::thin], U[::thin], (Y * np.exp(s * delay)[:, None])[::thin]
    poles, _, _ = vector_fitted(*own, (-0.01 + 1j) * at)
    inside = (poles.imag > BAND[0] * top) & (poles.imag < BAND[1] * top)
    poles = poles[inside & (-poles.real > SLOWEST * top)]
    poles, residues, direct = vector_fitted(*own, poles, 0)
    both = np.concatenate([residues, direct[:, None]], 1).reshape(
        U.shape[1], len(poles) + 1, outputs, -1
    )
    both = both.transpose(1, 2, 3, 0).reshape(len(poles) + 1, outputs, -1)
    left, sizes, right = np.linalg.svd(both[:-1])
    root = np.sqrt(sizes[:, :1])
    return Feedback(poles, right[:, 0] * root, (left[:, :, 0] * root).T, both[-1].real, delay)
