"""Which law of which drive would explain what a modal model leaves: before any channel is fitted.

A reaction W to a drive that the model predicts enters modes m by free b_m, and the outputs by a free d:

    y = sum of 2 Re(c_m b_m W / (s - p_m)) + d W

The share of the residuals that such columns explain is one small least-squares problem. Drives made of
measured outputs would explain themselves: they hold the reaction already.
"""

from typing import Any, NamedTuple

import numpy as np

from hysteresis import Feedback, StopsAndPowers
from hysteresis.dynamics._feedback import level_of

from ._feedback_search import Spectra, simulated
from ._feedback_unknowns import numbers_by_unknowns, settled_tangents
from ._periodic_tests import excited_lines
from ._vector_fitting import real


class Screened(NamedTuple):
    """The part of what a linear model leaves that a law of a drive explains, 0 to 1."""

    drive: str
    law: str
    share: float


GROUPS = ("inputs", "elongations", "differences", "modes")
"""What may drive channels, one an input: the inputs; what the outputs are worth in them, standing still;
what the outputs do not follow of them; the largest modes."""


def drives_of(model: Feedback, name: str) -> tuple[Any, Any]:
    """Rows (shapes, direct) of a group of drives."""
    nu, ny = model.inputs, model.outputs
    c, d, b = model.shapes[:ny], model.direct[:ny, :nu], model.entries[:, :nu]
    low = np.real(model.response(1e-3j * np.abs(model.poles[:1].imag))[0, :ny, :nu])
    still = np.linalg.pinv(low)
    if name == "inputs":
        return 0 * (still @ c), np.eye(nu)
    if name == "elongations":
        return still @ c, still @ d
    if name == "differences":
        return -(still @ c), np.eye(nu) - still @ d
    size = np.linalg.norm(c, axis=0) * np.linalg.norm(b, axis=1) / -model.poles.real
    shapes = np.zeros((min(nu, len(size)), len(size)), complex)
    for i, k in enumerate(np.argsort(-size)[:nu]):
        shapes[i, k] = 1j * np.exp(-0.5j * np.angle((b[k] ** 2).sum()))
    return shapes, np.zeros((len(shapes), nu))


def _probe(model: Feedback, shapes: Any, direct: Any, data: Spectra) -> list[Any]:
    """The spectra of drives (lines, drives), by the linear part."""
    probe = Feedback(model.poles, model.entries[:, : model.inputs], shapes, direct)
    G = probe.response(data.lines.s)
    return [(G @ u[:, :, None])[:, :, 0] for u in data.U]


def to_unit(model: Feedback, shapes: Any, direct: Any, data: Spectra) -> tuple[Any, Any]:
    """Drives of root mean square 1."""
    each = [np.var(data.lines.fine(z.T), axis=1) for z in _probe(model, shapes, direct, data)]
    rms = np.sqrt(np.mean(each, 0))[:, None]
    return shapes / rms, direct / rms


STOPS = (0.05, 0.2, 0.8)
"""Of the screening, in root mean squares of the drive."""

LAWS = {
    "stops": tuple(range(len(STOPS))), "square": (len(STOPS),), "cube": (len(STOPS) + 1,), "level": (-1,),
}  # fmt: skip
"""Which of the reactions to a drive they are; the last one is the drive by the logarithm of its level."""


def screening(model: Feedback, data: Spectra) -> tuple[tuple[Screened, ...], dict[str, float]]:
    """The share of what a model leaves that each law of each drive explains, the largest first, and for
    each group of drives what all their laws explain together."""
    ny, at = model.outputs, excited_lines(data.U)
    at = at[:: max(1, len(at) // 400)]
    s = data.lines.s[at]
    rest = data.left(simulated(model, data).output)[:, at]
    e = real(rest.ravel())
    P, Q = (1 / (s[:, None] - p) for p in (model.poles, model.poles.conj()))
    one, other = model.shapes[:ny] * P[:, None, :], model.shapes[:ny].conj() * Q[:, None, :]
    ways = np.concatenate([one + other, 1j * (one - other), np.tile(np.eye(ny), (len(s), 1, 1))], 2)
    ways[:, :, : 2 * len(model.poles)] *= np.exp(-s * model.delay)[:, None, None]

    def share(columns: list[np.ndarray]) -> float:
        wide = np.concatenate(columns, 1)
        size = np.linalg.norm(wide, axis=0)
        size = np.maximum(size, max(1e-9 * size.max(), 1e-100))  # of one level, log s is 0
        normal = wide.T @ wide / np.outer(size, size) + 1e-9 * np.eye(len(size))
        right = wide.T @ e / size
        return float(right @ np.linalg.solve(normal, right) / max(e @ e, 1e-300))

    numbers, by = numbers_by_unknowns(StopsAndPowers(STOPS, np.zeros(len(STOPS))))

    def reactions(drive: Any) -> Any:
        z = data.lines.fine(drive)
        w = settled_tangents(numbers, by, z, data.lines.step)
        return data.lines.coarse(np.vstack([w, z * np.log(level_of(z))]))[:, at]

    shares, by_group = [], {}
    for group in GROUPS:
        shapes, direct = to_unit(model, *drives_of(model, group), data)
        spectra = _probe(model, shapes, direct, data)
        everything = []
        for i in range(len(shapes)):
            W = np.stack([reactions(z[:, i]) for z in spectra])
            for law, which in LAWS.items():
                columns = []
                for k in which:
                    wide = W[:, k, :, None, None] * ways / data.size[:, None, :, None]
                    columns.append(real(wide.reshape(rest.size, -1)))
                shares.append(Screened(f"{group} {i + 1}", law, share(columns)))
                everything += columns
        by_group[group] = share(everything)
    return tuple(sorted(shares, key=lambda one: -one.share)), by_group
