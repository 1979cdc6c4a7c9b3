"""The unknowns of a `Feedback` model as one vector, and the derivatives of its steady state by them.

A change of anything changes some signal o = [y; z] or w directly. With the channels' equivalent gains k
around the loop, a direct change of z becomes A dz in the outputs and one of w becomes B dw:

    A = Gyw k (1 - Gzw k)^-1,     B = Gyw + A Gzw

What a change of z does to its own channel's w is exact, by the tangents of the law. Cost: one pass of each
law with a tangent for each mode and input. Strong reactions are not their equivalent gains; there `refined`
takes what the exact tangents N' give beside the gains, (N' - k) dz, around the loop once more, in turn.
"""

from typing import Any, NamedTuple, cast

import numpy as np

from hysteresis import Feedback, StopsAndPowers
from hysteresis.dynamics._feedback import Lines, Steady, level_of, settled
from hysteresis.dynamics._recorder import clock
from hysteresis.running import Numbers, numbers_of, tangents

from .._levels import HELD, STEPS

SLOWEST = 2e-4
"""Least decay of a pole, in parts of the highest excited frequency."""


def numbers_by_unknowns(law: Any) -> tuple[Numbers, np.ndarray]:
    """The numbers of a channel's law, and their derivatives by its unknowns, the weights of its stops and
    its powers: of those the law is made, after its thresholds."""
    numbers = numbers_of(law.tree())
    free = numbers.known.free[len(law.thresholds) :]
    return numbers, np.eye(len(numbers.m))[:, list(free)]


class Unknowns(NamedTuple):
    """What of a model may change: always the linear system and the reactions; where `entering`, how
    reactions enter; where `driven`, also what drives them."""

    entering: bool = True
    driven: bool = True

    def arrays(self, model: Feedback) -> list[np.ndarray]:
        """Poles, entries, shapes, direct terms of the outputs, delay, levels, laws, direct terms of the
        drives; of what is complex the real part stands before the imaginary one."""
        ny, nu = model.outputs, model.inputs
        v = None if self.entering else nu
        o, laws = None if self.driven else ny, cast(Any, model.channels)
        return [
            model.poles, model.entries[:, :v], model.shapes[:o], model.direct[:ny, :v],
            np.array([model.delay]), model.levels,
            *(np.asarray(x) for law in laws for x in (law.weights, law.powers)),
            model.direct[ny:o, :nu],
        ]  # fmt: skip

    def vector(self, model: Feedback) -> np.ndarray:
        own = map(np.ascontiguousarray, self.arrays(model))
        return np.concatenate([x.ravel().view(float) for x in own])

    def moved(self, model: Feedback, vector: np.ndarray) -> Feedback:
        found, at = [], 0
        for x in self.arrays(model):
            size = x.nbytes // vector.itemsize
            found.append(vector[at : at + size].view(x.dtype).reshape(x.shape))
            at += size
        poles, b, c, out, (delay,), levels, *laws, drives = found
        d, ny = model.direct.copy(), model.outputs
        d[:ny, : out.shape[1]], d[ny : ny + len(drives), : model.inputs] = out, drives
        each: Any = zip(model.channels, laws[::2], laws[1::2], strict=True)
        own = [StopsAndPowers(x.thresholds, *both) for x, *both in each]
        return Feedback(
            -np.maximum(-poles.real, SLOWEST) + 1j * poles.imag,
            np.concatenate([b, model.entries[:, b.shape[1] :]], 1),
            np.concatenate([c, model.shapes[len(c) :]]), d, max(delay, 0.0), own, levels, model.memory,
        )  # fmt: skip


class Point(NamedTuple):
    """Where derivatives are taken: one realisation's inputs (lines, inputs) and steady state, the response
    G, the channels' equivalent gains, and the numbers of their laws with derivatives by their unknowns."""

    model: Feedback
    lines: Lines
    U: Any
    state: Steady
    G: Any
    gains: np.ndarray
    reactions: list[tuple[Any, np.ndarray]]


def equivalent_gains(Z: Any, W: Any) -> np.ndarray:
    """W / Z of each channel by least squares over realisations, (realisations, channels, lines)."""
    power = np.maximum((np.abs(Z) ** 2).sum((0, 2)), 1e-300)
    return (Z.conj() * W).sum((0, 2)) / power


Change = tuple[tuple[Any, Any], ...]
"""By unknowns (r, c), before it goes around the loop: the signals [y; z; w], y before its delay, change by
the sum over some terms of to (lines or 1, signals, r) times by (lines, c)."""


def changes(point: Point, unknowns: Unknowns) -> list[Change]:
    """Of all unknowns, in their order. A drive that takes more of a signal changes its own reaction, by the
    tangents of the law."""
    model, lines = point.model, point.lines
    ny, nu, n = model.outputs, model.inputs, len(model.channels)
    v = np.concatenate([point.U, point.state.reactions.T], 1)
    P, Q = (1 / (lines.s[:, None] - p) for p in (model.poles, model.poles.conj()))
    X, Xc = P * (v @ model.entries.T), Q * (v @ model.entries.conj().T)
    y, _, w = np.split(np.eye(ny + 2 * n)[None], [ny, ny + n], 2)
    one = np.concatenate([model.shapes, np.zeros((n, len(model.poles)))])[None]
    other = one.conj()

    def pairs(a: Any, b: Any) -> Any:
        """Columns by real and imaginary parts in turn."""
        return np.stack([a, b], 2).reshape(len(a), -1)

    by_pole = [
        (
            (one[:, :, m], pairs((P * X)[:, m], 1j * (P * X)[:, m])),
            (other[:, :, m], pairs((Q * Xc)[:, m], -1j * (Q * Xc)[:, m])),
        )
        for m in np.arange(len(model.poles))[:, None]
    ]
    entering = v if unknowns.entering else v[:, :nu]
    by_entry = (
        (one * P[:, None], pairs(entering, 1j * entering)),
        (other * Q[:, None], pairs(entering, -1j * entering)),
    )
    late = (point.G[:, :ny] @ v[:, :, None]) * np.exp(lines.s * model.delay)[:, None, None]
    by_delay = ((np.pad(late, ((0, 0), (0, 2 * n), (0, 0))), -lines.s[:, None]),)
    # What drives take from modes and inputs, and the numbers of their laws, each channel in turn.
    modes = pairs(X + Xc, 1j * (X - Xc))
    signals = np.concatenate([modes, v[:, :nu]], 1)[:, : None if unknowns.driven else 0]
    first, wide = min(modes.shape[1], signals.shape[1]), signals.shape[1]
    fine = lines.fine(signals.T.astype(np.complex64, order="C")).T
    reactions = [reacting(point, i, signals, fine).T for i in range(n)]
    by_shape, by_level, by_law, by_direct = (
        [((w[:, :, [i]], dW[:, columns]),) for i, dW in enumerate(reactions)]
        for columns in (np.s_[:first], np.s_[-1:], np.s_[wide:-1], np.s_[first:wide])
    )
    return [
        *by_pole, by_entry, ((y, modes),), *by_shape, ((y, entering),), by_delay, *by_level, *by_law,
        *by_direct,
    ]  # fmt: skip


def reacting(point: Point, i: int, dZ: np.ndarray, dz: np.ndarray, own: bool = True) -> np.ndarray:
    """Changes of the reaction w_i by changes of its drive, dZ (lines, signals) or dz (fine, signals), where
    `own` by its law's unknowns, and by its level, (columns, lines)."""
    lines, (numbers, dm), Z = point.lines, point.reactions[i], point.state.drives[i]
    z, signals = lines.fine(Z), dz.shape[1]
    dm = np.concatenate([np.zeros((len(dm), signals)), dm if own else dm[:, :0]], 1)
    dW = lines.coarse(settled_tangents(numbers, dm, z, lines.step, dz))
    s, level = level_of(z), point.model.levels[i]
    dW[:signals] += level * (np.log(s) * dZ + np.outer(Z, z @ dz) / (len(z) * s**2)).T
    return np.concatenate([dW, np.log(s) * Z[None]])


def settled_tangents(
    numbers: Numbers, dm: np.ndarray, z: np.ndarray, h: float, dz: np.ndarray | None = None
) -> np.ndarray:
    """Of the output over a period in steady state, (columns, fine), by those of the numbers, of which the
    first are those of the drive, dz (fine, signals)."""
    order = settled(numbers, z, h)[1]
    begin = len(order) - len(z)
    moved = np.zeros((len(order), dm.shape[1]))
    if dz is not None:
        moved[:, : dz.shape[1]] = dz[order]
    found = tangents(numbers, dm, z[order], clock(len(order), h), moved, kept=(begin, 1)).columns
    # In half the precision: a third of the time.
    columns = np.empty(found.shape[::-1], np.float32)
    columns[:, order[begin:]] = found.T
    return columns


def around(point: Point, kept: slice) -> np.ndarray:
    """What a change of [y; z; w] comes to in [y; z] around the loop, by the equivalent gains at the lines
    `kept`, (lines, to, from)."""
    ny, nu, n = point.model.outputs, point.model.inputs, len(point.gains)
    Gyw, Gzw = np.split(point.G[kept, :, nu:], [ny], 1)
    inverse = np.linalg.inv(np.eye(n) - Gzw * point.gains)
    drives = np.concatenate([np.zeros((len(Gzw), n, ny)), inverse, inverse @ Gzw], 2)
    late = np.exp(-point.lines.s[kept] * point.model.delay)[:, None, None] * np.eye(ny)
    outputs = np.concatenate([late, 0 * Gyw, Gyw], 2) + (Gyw * point.gains) @ drives
    return np.concatenate([outputs, drives], 1)


def jacobian(T: np.ndarray, of: list[Change], kept: slice) -> np.ndarray:
    """d signals / d unknowns at the lines `kept`, (lines, signals, unknowns), by rows of `around` there."""
    columns = []
    for change in of:
        each = ((T @ (to if len(to) == 1 else to[kept]), by[kept]) for to, by in change)
        found = sum(to[..., None] * by[:, None, None, :] for to, by in each)
        columns.append(np.asarray(found, np.complex64).reshape(*T.shape[:2], -1))
    return np.concatenate(columns, 2)


def refined(point: Point, of: list[Change], rounds: int = STEPS) -> tuple[np.ndarray, float]:
    """`jacobian` at all lines with exact tangents around the loop; and how far off that one is, as a part
    of the drives' changes."""
    ny, n, every = point.model.outputs, len(point.gains), slice(None)
    T, loop = around(point, every), point.G[:, point.model.outputs :, point.model.inputs :]
    found = first = jacobian(T, of, every)
    off = 0.0
    for turn in range(rounds):
        dZ = found[:, ny:]
        fine = (point.lines.fine(dZ[:, i].T).T for i in range(n))
        each = [reacting(point, i, dZ[:, i], dz, own=False)[:-1].T for i, dz in enumerate(fine)]
        beside = np.stack(each, 1)
        beside -= point.gains[:, None] * dZ
        found = (first + T[:, :, -n:] @ beside).astype(np.complex64)
        size = float(np.linalg.norm(loop @ beside) / max(np.linalg.norm(dZ), 1e-300))
        off = off if turn else size
        if size < HELD:  # what is left of the drives' changes around the loop
            break
    return found, off
