"""The unknowns of a `Feedback` model as one vector, and the derivatives of its steady state by them.

A change of anything changes some signal o = [y; z] or w directly. With the channels' equivalent gains k
around the loop, a direct change of z becomes A dz in the outputs and one of w becomes B dw:

    A = Gyw k (1 - Gzw k)^-1,     B = Gyw + A Gzw

What a change of z does to its own channel's w is exact, by the tangents of the law. Cost: one pass of each
law with a tangent for each mode and input. Strong reactions are not their equivalent gains; there `refined`
solves dz = direct + Gzw N' dz with the exact tangents N' for every unknown, the gains being its
preconditioner.
"""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from hysteresis import AbstractModel, Feedback, parameters
from hysteresis.dynamics._feedback import Lines, Steady, clock_of, level_of
from hysteresis.running import numbers_of, tangents

from ..parameters._settings import replaced

EXACT, ROUNDS = 0.03, 12
"""Part of the drives' changes that is left around the loop at last, and most rounds."""

SLOWEST = 2e-4
"""Least decay of a pole, in units of the frequencies at hand."""


class Reaction(NamedTuple):
    """The unknowns of a channel's law."""

    channel: AbstractModel

    @property
    def values(self) -> dict[str, Any]:
        """By the names of parameters that are not fixed."""
        return {name: value for name, info, value in parameters(self.channel) if not info.fixed}

    def vector(self) -> np.ndarray:
        return np.concatenate([np.zeros(0), *map(np.ravel, self.values.values())])

    def moved(self, vector: Any) -> AbstractModel:
        model, at = self.channel, 0
        for name, value in self.values.items():
            shape, size = np.shape(value), int(np.size(value))
            model = replaced(model, name, jnp.reshape(jnp.asarray(vector[at : at + size]), shape))
            at += size
        return model

    def numbers(self) -> tuple[Any, np.ndarray]:
        """Of its law, and their derivatives by the unknowns."""
        by = jax.jacfwd(lambda x: numbers_of(self.moved(x).tree()).m)(jnp.asarray(self.vector()))
        return numbers_of(self.channel.tree()), np.asarray(by, float)


class Unknowns(NamedTuple):
    """What of a model may change: always the linear system and the reactions; where `entering`, how
    reactions enter; where `driven`, also what drives them."""

    entering: bool = True
    driven: bool = True

    def _slices(self, model: Feedback) -> tuple[Any, ...]:
        v = None if self.entering else model.inputs
        o = None if self.driven else model.outputs
        return (
            np.s_[:, :v],
            np.s_[:o],
            np.s_[: model.outputs, :v],
            np.s_[model.outputs :, : model.inputs],
        )

    def vector(self, model: Feedback) -> np.ndarray:
        entries, shapes, out, drives = self._slices(model)
        complexes = model.poles, model.entries[entries], model.shapes[shapes]
        parts = [np.concatenate([x.real.ravel(), x.imag.ravel()]) for x in complexes]
        parts += [model.direct[out].ravel(), np.array([model.delay]), model.levels]
        parts += [Reaction(channel).vector() for channel in model.channels]
        parts += [model.direct[drives].ravel()] if self.driven else []
        return np.concatenate(parts)

    def moved(self, model: Feedback, vector: np.ndarray) -> Feedback:
        at = 0

        def take(size: int) -> np.ndarray:
            nonlocal at
            at += size
            return vector[at - size : at]

        def take_complex(size: int) -> Any:
            return take(size) + 1j * take(size)

        entries, shapes, out, drives = self._slices(model)
        poles = take_complex(len(model.poles))
        poles = -np.maximum(-poles.real, SLOWEST) + 1j * poles.imag
        b, c, d = model.entries.copy(), model.shapes.copy(), model.direct.copy()
        b[entries] = take_complex(b[entries].size).reshape(b[entries].shape)
        c[shapes] = take_complex(c[shapes].size).reshape(c[shapes].shape)
        d[out] = take(d[out].size).reshape(d[out].shape)
        delay, levels = max(float(take(1)[0]), 0.0), take(len(model.levels))
        own = [Reaction(x) for x in model.channels]
        channels = tuple(x.moved(take(len(x.vector()))) for x in own)
        if self.driven:
            d[drives] = take(d[drives].size).reshape(d[drives].shape)
        return Feedback(poles, b, c, d, delay, channels, levels, model.memory)


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

    @property
    def motion(self) -> tuple[Any, Any, Any, Any, Any]:
        """[u; w], 1 / (s - p) and the modes, each also of the conjugate poles."""
        v, s, model = np.concatenate([self.U, self.state.reactions.T], 1), self.lines.s, self.model
        P, Q = (1 / (s[:, None] - p) for p in (model.poles, model.poles.conj()))
        return v, P, Q, P * (v @ model.entries.T), Q * (v @ model.entries.conj().T)


def equivalent_gains(Z: Any, W: Any) -> np.ndarray:
    """W / Z of each channel by least squares over realisations, (realisations, channels, lines)."""
    power = np.maximum((np.abs(Z) ** 2).sum((0, 2)), 1e-300)
    return (Z.conj() * W).sum((0, 2)) / power


def jacobian(point: Point, unknowns: Unknowns, kept: slice) -> np.ndarray:
    """d output / d unknowns at the lines `kept`, (outputs, lines, unknowns)."""
    model, lines, gains = point.model, point.lines, point.gains
    ny, nu, n, M = model.outputs, model.inputs, len(model.channels), len(model.poles)
    motion = whole, *_, X_all, Xc_all = point.motion
    v, P, Q, X, Xc = (x[kept] for x in motion)
    s, G = lines.s[kept], point.G[kept]
    late = np.exp(-s * model.delay)[:, None]
    Gyw, Gzw = G[:, :ny, nu:], G[:, ny:, nu:]
    A = (Gyw * gains) @ np.linalg.inv(np.eye(n) - Gzw * gains)
    B = Gyw + A @ Gzw
    to_outputs = np.concatenate([late[:, :, None] * np.eye(ny), A], 2)
    one, other = to_outputs @ model.shapes, to_outputs @ model.shapes.conj()
    columns: list[np.ndarray] = []

    def add(*blocks: Any) -> None:
        """(lines, outputs, ...) each"""
        columns.extend(np.asarray(x, np.complex64).reshape(len(s), ny, -1) for x in blocks)

    def each_output(signals: Any) -> Any:
        """A change of the outputs, one after the other, by signals (lines, signals)."""
        return np.eye(ny)[:, :, None] * (late * signals)[:, None, None, :]

    both = one * (P * X)[:, None, :], other * (Q * Xc)[:, None, :]
    add(both[0] + both[1], 1j * (both[0] - both[1]))
    entering = v if unknowns.entering else v[:, :nu]
    by_mode = (
        (one * P[:, None, :])[..., None] * entering[:, None, None, :],
        (other * Q[:, None, :])[..., None] * entering[:, None, None, :],
    )
    add(by_mode[0] + by_mode[1], 1j * (by_mode[0] - by_mode[1]))
    # What drives takes from modes and inputs, each channel in turn, and their laws' numbers.
    modes = X_all + Xc_all, 1j * (X_all - Xc_all)
    signals = (
        np.concatenate([*modes, whole[:, :nu]], 1) if unknowns.driven else np.zeros((len(whole), 0))
    )
    fine = lines.fine(signals.T).T
    found = [
        B[:, :, i, None] * dW[:, kept].T[:, None, :] for i, dW in enumerate(_by_drive(point, fine))
    ]
    wide = fine.shape[1]
    for part, mode in enumerate(modes):
        add(
            np.concatenate(
                [each_output(mode[kept]).reshape(len(s), ny, -1)]
                + [x[..., part * M : (part + 1) * M] for x in found if unknowns.driven],
                2,
            )
        )
    add(each_output(entering), -s[:, None] * (G[:, :ny] @ v[:, :, None])[:, :, 0])
    add(*(x[..., -1] for x in found), *(x[..., wide:-1] for x in found))
    add(*(x[..., 2 * M : wide] for x in found if unknowns.driven))
    return np.concatenate(columns, 2).transpose(1, 0, 2)


def _by_drive(point: Point, fine: np.ndarray) -> Any:
    """Of each channel: what its reaction changes by changes of its drive, by its law's unknowns and by its
    level, (columns, lines)."""
    for i in range(len(point.model.channels)):
        numbers, dm = point.reactions[i]
        z = point.lines.fine(point.state.drives[i])
        dw = _tangent(point, i, z, fine, numbers, dm)
        yield point.lines.coarse(np.column_stack([dw, z * np.log(level_of(z))]).T)


def _tangent(
    point: Point, i: int, z: np.ndarray, dz: np.ndarray, numbers: Any, dm: np.ndarray
) -> np.ndarray:
    """Changes of the reaction w_i in fine steps, by changes dz (fine, signals) of its drive and by its
    law's unknowns, (fine, columns)."""
    both = np.zeros((2 * len(z), dz.shape[1] + dm.shape[1]))
    both[:, : dz.shape[1]] = np.tile(dz, (2, 1))
    wide = np.concatenate([np.zeros((len(dm), dz.shape[1])), dm], 1)
    clock = clock_of(point.lines)
    dw = tangents(numbers, wide, np.tile(z, 2), clock, both, kept=(len(z), 1)).columns
    s, level = level_of(z), point.model.levels[i]
    if dz.shape[1]:
        by_level = np.log(s) * dz + np.outer(z, z @ dz) / (len(z) * s**2)
        dw[:, : dz.shape[1]] += level * by_level
    return dw


def refined(
    point: Point, unknowns: Unknowns, kept: slice, which: np.ndarray | None = None
) -> tuple[np.ndarray, float]:
    """`jacobian` with exact tangents around the loop, of the unknowns `which`; and how far off that one is,
    as a part of the drives' changes."""
    model, lines = point.model, point.lines
    ny, nu, n = model.outputs, model.inputs, len(model.channels)
    dy, dz, dw = _direct(point, unknowns, which)  # (unknowns, lines, signals) each
    Gyw, Gzw = point.G[:, :ny, nu:], point.G[:, ny:, nu:]
    inverse = np.linalg.inv(np.eye(n) - Gzw * point.gains)
    drives = [lines.fine(z) for z in point.state.drives]
    around = np.zeros_like(dw)
    changes = np.zeros_like(dz)
    off = 0.0
    for turn in range(ROUNDS):
        rest = dz + _times(Gzw, dw + around) - changes
        size = float(np.linalg.norm(rest) / max(np.linalg.norm(changes), 1e-300))
        if turn == 1:
            off = size
        if turn and size < EXACT:
            break
        changes = changes + _times(inverse, rest)
        for i, (numbers, dm) in enumerate(point.reactions):
            fine = lines.fine(changes[:, :, i]).T
            found = _tangent(point, i, drives[i], fine, numbers, dm[:, :0])
            around[:, :, i] = lines.coarse(found.T)
    found = dy + _times(Gyw, dw + around)
    return found[:, kept].transpose(2, 1, 0).astype(np.complex64), off


def _times(matrices: Any, x: Any) -> Any:
    """Matrices (lines, to, from) on signals (unknowns, lines, from)."""
    return (matrices[None] @ x[..., None])[..., 0]


def _direct(point: Point, unknowns: Unknowns, which: np.ndarray | None) -> tuple[Any, Any, Any]:
    """What each unknown changes before it goes around the loop: outputs, drives and reactions, (unknowns,
    lines, signals) each."""
    model, lines = point.model, point.lines
    ny, nu, n, M = model.outputs, model.inputs, len(model.channels), len(model.poles)
    v, P, Q, X, Xc = point.motion
    into = v.shape[1] if unknowns.entering else nu
    upto = ny + n if unknowns.driven else ny
    by_law = [*_by_drive(point, np.zeros((lines.samples * lines.finer, 0)))]
    none: Any = np.zeros((len(v), ny + 2 * n), complex)
    both = np.concatenate([model.shapes, np.zeros((n, M))]).T

    def at(k: int, signal: Any) -> Any:
        change = none.copy()
        change[:, k] = signal
        return change

    def through(m: int, one: Any, other: Any, part: int) -> Any:
        """By mode m; `part` 0 is the real one."""
        a, b = np.outer(one, both[m]), np.outer(other, both[m].conj())
        return a + b if part == 0 else 1j * (a - b)

    def delayed() -> Any:
        y = (point.G[:, :ny] @ v[:, :, None])[:, :, 0] * np.exp(lines.s * model.delay)[:, None]
        return np.concatenate([-lines.s[:, None] * y, none[:, ny:]], 1)

    parts, each = (0, 1), range(M)
    changes: list[Any] = [
        *(partial(through, m, P[:, m] * X[:, m], Q[:, m] * Xc[:, m], k) for k in parts for m in each),
        *(
            partial(through, m, P[:, m] * v[:, i], Q[:, m] * v[:, i], k)
            for k in parts for m in each for i in range(into)
        ),
        *(
            partial(at, k, modes[:, m])
            for modes in (X + Xc, 1j * (X - Xc)) for k in range(upto) for m in each
        ),
        *(partial(at, k, v[:, i]) for k in range(ny) for i in range(into)),
        delayed,
        *(partial(at, ny + n + i, found[-1]) for i, found in enumerate(by_law)),
        *(partial(at, ny + n + i, one) for i, found in enumerate(by_law) for one in found[:-1]),
    ]  # fmt: skip
    if unknowns.driven:
        changes += [partial(at, ny + k, v[:, i]) for k in range(n) for i in range(nu)]
    chosen = range(len(changes)) if which is None else which
    found = np.stack([changes[k]() for k in chosen])
    late = np.exp(-lines.s * model.delay)[:, None]
    return late * found[..., :ny], found[..., ny : ny + n], found[..., ny + n :]
