"""A linear system with hysteretic channels: a modal model whose reactions are laws of one input.

The steady state under a periodic input is the fixed point of

    Z -> Gzu U + Gzw W(Z)

over the lines of the spectrum; W runs the laws over z in fine steps, from rest at its largest value. A
step solves it with each channel replaced by its equivalent gain, and the last six steps are mixed (Anderson
1965). From rest it is the same fixed point with the modes' exact step between samples, window by window.
Cost of a step: one pass of the laws.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import equinox as eqx
import numpy as np
import scipy
from jaxtyping import Complex, Float, Int
from numpy.typing import ArrayLike

from .._errors import InputError
from .._model import DOUBLE, AbstractModel, Tree, complete
from .._registry import register
from ..running import Numbers, numbers_of, run
from ..trees import node
from ._feedback_in_time import in_time

Outputs = Float[np.ndarray, "samples outputs"]
Matrix = Any

CLOSE, STEPS, MIXED, FAILED = 1e-5, 25, 6, 6
"""Of the steady state: part of the drives that the last step leaves, most steps, how many are mixed, and
how many may go astray."""

ROUNDING = 1e-9
"""Part by which numbers of one state may differ."""

CLIMB = (0.4, 0.6, 0.75, 0.87, 0.95, 1.0)
"""Parts of the amplitude by which it is climbed where the steady state is not found at once."""


class Lines(NamedTuple):
    """The spectra of periodic signals: samples of a period, the time between them, fine steps of each."""

    samples: int
    dt: float
    finer: int = 4

    @property
    def count(self) -> int:
        """From 0 to below half the sampling rate."""
        return (self.samples + 1) // 2

    @property
    def period(self) -> float:
        return self.samples * self.dt

    @property
    def s(self) -> Complex[np.ndarray, " lines"] | Any:
        return 2j * np.pi * np.arange(self.count) / self.period

    @property
    def step(self) -> float:
        """Of the laws."""
        return self.dt / self.finer

    def of(self, x: Float[np.ndarray, "samples signals"]) -> Complex[np.ndarray, "lines signals"]:
        return np.fft.rfft(x, axis=0)[: self.count]

    def signal(self, spectrum: Complex[np.ndarray, "lines signals"]) -> Any:
        return np.fft.irfft(spectrum, self.samples, axis=0)

    def fine(self, spectrum: Complex[np.ndarray, "*signals lines"]) -> Any:
        """In fine steps."""
        size = self.samples * self.finer
        return scipy.fft.irfft(spectrum * self.finer, size, axis=-1)

    def coarse(self, fine: Float[np.ndarray, "*signals fine"]) -> Any:
        """The spectrum of what fine steps found."""
        return scipy.fft.rfft(fine, axis=-1)[..., : self.count] / self.finer


class Steady(NamedTuple):
    """A periodic steady state in its lines: outputs (lines, outputs), drives and reactions (channels,
    lines), and the part of the drives that the last step left."""

    output: Any
    drives: Any
    reactions: Any
    left: float


@register
class Feedback(eqx.Module):
    """A linear system of several inputs and outputs with hysteretic channels.

        x_m' = poles_m x_m + entries_m [u; w],     [y; z] = 2 Re(shapes x) + direct [u; w],
        w_i = N_i[z_i] + levels_i z_i log s_i,      memory (s_i^2)' = z_i^2 - s_i^2

    y is read `delay` later. Each channel has a drive z_i, which takes what it may from modes and inputs,
    and a reaction w_i, any law of one input, which enters like an input. s_i is the slow mean amplitude of
    the drive: with it the stiffness follows the logarithm of the level. Without channels it is a modal
    model.

    **Arguments:** (M modes, one of each conjugate pair; n_u inputs, n_y outputs, n channels)

    - `poles`: (M,) complex, real parts negative. `entries`: (M, n_u + n). `shapes`: (n_y + n, M).
    - `direct`: (n_y + n, n_u + n), real; none from reactions to drives, which would be a loop without time.
    - `delay`: of the outputs. `channels`: n models of one input. `levels`: (n,).
    - `memory`: time constant of s for motion in time; in steady state s is the root mean square.

    Raises `InputError` where shapes differ, a pole does not decay, a reaction enters a drive at once, the
    delay is negative or the memory not positive.

    Source: modal superposition, Gawronski 2004; nonlinear feedback of a linear system, Schoukens and Tiels
    2017.

    **Example:**

        >>> spring = hysteresis.StopsAndPowers([0.2], [-0.5])
        >>> direct = np.zeros((2, 2))
        >>> beam = hysteresis.Feedback(
        ...     [-0.1 + 2j], [[-0.25j, -0.25j]], [[1], [1]], direct, channels=(spring,), levels=[0.0]
        ... )
        >>> u = np.sin(2 * np.pi * np.arange(64) / 64)
        >>> y = beam.steady(u[:, None], dt=0.1)
        >>> y.shape, float(np.ptp(y).round(2))
        ((64, 1), 0.58)
    """

    poles: Any = eqx.field(converter=lambda x: np.asarray(x, complex))
    entries: Matrix = eqx.field(converter=lambda x: np.asarray(x, complex))
    shapes: Matrix = eqx.field(converter=lambda x: np.asarray(x, complex))
    direct: Matrix = eqx.field(converter=lambda x: np.asarray(x, float))
    delay: float = 0.0
    channels: tuple[AbstractModel, ...] = eqx.field(converter=tuple, default=())
    levels: Any = eqx.field(converter=lambda x: np.asarray(x, float), default=())
    memory: float = np.inf

    def __check_init__(self) -> None:
        n = len(self.channels)
        arrays = self.poles, self.entries, self.shapes, self.direct, self.levels
        sizes = [x.shape for x in arrays]
        modes, (rows, columns) = self.poles.size, sizes[3] if len(sizes[3]) == 2 else (0, 0)
        wanted = [(modes,), (modes, columns), (rows, modes), (rows, columns), (n,)]
        if rows <= n or columns <= n or sizes != wanted:
            raise InputError(
                "length-mismatch",
                f"poles, entries, shapes, direct and levels of the shapes {', '.join(map(str, sizes))} for"
                f" {n} channels.",
                fix="give (modes,), (modes, inputs + channels), (outputs + channels, modes), (outputs +"
                " channels, inputs + channels) and (channels,).",
            )
        if not all(isinstance(channel, AbstractModel) for channel in self.channels):
            raise InputError(
                "bad-parts", "a channel is not a model.", fix="give models of one input."
            )
        loop = self.direct[rows - n :, columns - n :]
        known = all(np.isfinite(x).all() for x in arrays)
        timed = self.delay >= 0 and self.memory > 0
        if not (known and timed) or (self.poles.real >= 0).any() or loop.any():
            raise InputError(
                "parameter-out-of-bounds",
                "a number is not finite, a pole does not decay, a reaction enters a drive at once, or a"
                f" time is out of bounds: delay={self.delay:g}, memory={self.memory:g}.",
                fix="give poles of negative real part, zeros from reactions to drives, a delay of 0 or more"
                " and a memory above 0.",
            )

    @classmethod
    def of_masses(
        cls,
        mass: ArrayLike,
        damping: ArrayLike,
        stiffness: ArrayLike,
        hysteresis: Sequence[AbstractModel | None] = (),
        links: ArrayLike | None = None,
    ) -> "Feedback":
        """Masses with dampers, springs and hysteretic links between them.

            M y'' + C y' + K y + L' z[L y] = u

        Inputs are the forces u on all masses, outputs their displacements y; L y are the stretches of the
        links, and z their hysteretic forces. A row of L says what stretches a link: (1, -1) is the
        difference of two coordinates, (0, 1) the second one against the ground. Without `links` the masses
        are a chain from a wall outwards, and link l joins mass l to the one before.

        **Arguments:**

        - `mass`: (n,) masses, or (n, n) a symmetric, positive definite matrix.
        - `damping`, `stiffness`: (l,) of the dampers and springs beside each link, or (n, n) symmetric
          matrices. Every mode has to decay.
        - `hysteresis`: a model of each link's force over its stretch, or None for a link without.

        Raises `InputError` where shapes differ, a matrix is not symmetric, a mass is not positive, or a
        mode does not decay.

        Source: Clough and Penzien, Dynamics of Structures (1993).

        **Example:**

            >>> spring = hysteresis.BoucWenForce(alpha=5e4, beta_gamma=800.0)
            >>> chain = hysteresis.Feedback.of_masses([2.0, 1.0], [10.0, 10.0], [5e4, 3e4], (spring, None))
            >>> force = 40 * np.sin(np.arange(64) / 4)
            >>> y = chain.simulate(np.stack([0 * force, force], 1), dt=1 / 750)
            >>> (1e3 * np.abs(y).max(0)).round(2).tolist()
            [1.71, 3.18]
        """
        M, C, K = (np.asarray(x, float) for x in (mass, damping, stiffness))
        n = M.shape[-1] if M.ndim else 0
        chain = np.eye(n) - np.eye(n, k=-1)
        L = chain if links is None else np.atleast_2d(np.asarray(links, float))
        sizes, count = [x.shape for x in (M, C, K, L)], len(L)
        models = tuple(hysteresis) or (None,) * count
        fits = sizes[0] in ((n,), (n, n)) and all(s in ((count,), (n, n)) for s in sizes[1:3])
        if n < 1 or not fits or sizes[3] != (count, n) or len(models) != count:
            raise InputError(
                "length-mismatch",
                f"masses, dampings, stiffnesses and links of the shapes {', '.join(map(str, sizes))}, and"
                f" {len(models)} entries of hysteresis.",
                fix="give n masses or an n by n matrix, and of the others one a link or an n by n matrix.",
            )
        M = np.diag(M) if M.ndim == 1 else M
        C, K = (x if x.ndim == 2 else L.T @ (x[:, None] * L) for x in (C, K))
        symmetric = all(np.allclose(x, x.T, rtol=1e-9, atol=0) for x in (M, C, K))
        if not symmetric or not (np.linalg.eigvalsh(M) > 0).all():
            raise InputError(
                "parameter-out-of-bounds",
                "a matrix is not symmetric, or a mass is not positive.",
                cause="without a mass the force sets no acceleration.",
                fix="give the matrices of an assembled structure, and positive masses.",
            )
        drives = L[[one is not None for one in models]]
        into = np.linalg.solve(M, np.hstack([np.eye(n), -drives.T]))
        motion = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, np.hstack([K, C]))]])
        poles, right = np.linalg.eig(motion)
        # One of each pair, whose conjugate `response` adds; half of a real pole, which is its own.
        kept, counts = np.imag(poles) >= 0, np.where(np.imag(poles) == 0, 0.5, 1.0)
        entries = np.linalg.inv(right)[kept, n:] @ into
        shapes = np.vstack([np.eye(n), drives]) @ (right[:n] * counts)[:, kept]
        channels = [one for one in models if one is not None]
        direct = np.zeros((n + len(drives), n + len(drives)))
        return cls(poles[kept], entries, shapes, direct, 0.0, channels, np.zeros(len(drives)))

    @property
    def inputs(self) -> int:
        return self.direct.shape[1] - len(self.channels)

    @property
    def outputs(self) -> int:
        return self.direct.shape[0] - len(self.channels)

    def response(self, s: Complex[np.ndarray, " lines"]) -> Complex[np.ndarray, "lines to from"]:
        """From [u; w] to [y; z], the outputs delayed, at s = 2 pi i f."""
        one, other = (1 / (s[:, None] - p) for p in (self.poles, self.poles.conj()))
        found = (self.shapes * one[:, None, :]) @ self.entries + self.direct
        found = found + (self.shapes.conj() * other[:, None, :]) @ self.entries.conj()
        found[:, : self.outputs] *= np.exp(-s * self.delay)[:, None, None]
        return found

    def laws(self) -> tuple[Numbers, ...]:
        """Of the channels, in numbers."""
        return tuple(numbers_of(channel.tree()) for channel in self.channels)

    def tree(self, eps: float = DOUBLE, depth: int = 64, substeps: int = 16) -> Tree:
        """Of one input and one output as a law, whose `find` goes from one to the other, as of a model.

        - `substeps`: of a sample, in each of which the input is straight.

        Raises `InputError` `not-exportable` for several inputs or outputs, and a delay.
        """
        if self.inputs != 1 or self.outputs != 1 or self.delay:
            raise InputError(
                "not-exportable",
                f"it has {self.inputs} inputs, {self.outputs} outputs and a delay of {self.delay:g}.",
                cause="a law has one input and one output at the same time.",
                fix="give dataclasses.replace(model, delay=0.0), and one input and output of it.",
            )
        n, modes, b, c = len(self.channels), len(self.poles), self.entries, self.shapes
        known = {
            "substeps": substeps, "modes": modes, "channels": n, "memory": min(self.memory, 1e30),
            "decay": self.poles.real, "turn": self.poles.imag, "enter": b.real, "enters": b.imag,
            "show": c.real, "shows": c.imag, "direct": self.direct, "level": self.levels,
        }  # fmt: skip
        of_modes = dict.fromkeys(
            ("x", "xs", "keep", "keeps", "hold", "holds", "rise", "rises"), modes
        )
        sizes = of_modes | dict.fromkeys(("w", "square", "free", "new"), n) | {"gain": n * n}
        state = dict.fromkeys(("u", "stays", "change", "largest"), 0.0) | {"begun": 0, "pace": -1.0}
        state |= {name: np.zeros(max(size, 1)) for name, size in sizes.items()}
        flat = {k: np.ravel(x) if np.ndim(x) else x for k, x in known.items()}
        return node("feedback", flat, state, [x.tree(eps, depth) for x in self.channels])

    def steady(self, u: ArrayLike, dt: float, finer: int = 4) -> Outputs:
        """The outputs of one period in steady state.

        - `u`: (samples, inputs), one period on an even clock, which is taken as limited to its band.
        - `finer`: steps of the laws to a sample.

        Laws run two periods at most, of which the last counts: their memory has to be forgotten within
        a period. s is the root mean square of a drive over the period, whatever the `memory`.

        Raises `InputError` `diverged` where a step still changes the drives by a thousandth of their size,
        and as `simulate` for other inputs.
        """
        u = self._checked(u, dt, finer)
        lines = Lines(len(u), dt, finer)
        found = steady_state(self, lines, lines.of(u))
        if not found.left < 100 * CLOSE:
            raise InputError(
                "diverged",
                f"the last step still changes the drives by {found.left:.1g} of their size.",
                cause="the channels' gain around the loop is too large at this amplitude.",
                fix="give a smaller input, or simulate it in time.",
            )
        return lines.signal(found.output)

    def simulate(self, u: ArrayLike, dt: float, finer: int = 16) -> Outputs:
        """The outputs from rest, at the samples of `u` (samples, inputs) on an even clock.

        Between samples the input is limited to its band, and straight between `finer` fine steps of each.
        That loses (pi f dt / finer)^2 / 3 of a component of frequency f. The first and the last 32 samples
        rely on how a linear prediction continues the input.

        Raises `InputError` `length-mismatch` or `not-finite` for other inputs, `bad-option` for a step that
        is none, and where there are levels and no `memory`, and `diverged` where the channels' loop has no
        solution.
        """
        if self.levels.any() and not np.isfinite(self.memory):
            said = "memory is infinite, and from rest the mean amplitude of a drive has to begin."
            mend = "give the model's time constant: dataclasses.replace(model, memory=SECONDS)."
            raise InputError("bad-option", said, fix=mend)
        return in_time(self, self._checked(u, dt, finer), dt, finer)

    def _checked(self, u: ArrayLike, dt: float, finer: int) -> Float[np.ndarray, "samples inputs"]:
        """Inputs that can be simulated."""
        u = np.asarray(u, float)
        if u.ndim != 2 or not len(u) or u.shape[1] != self.inputs:
            said = f"inputs of the shape {u.shape} for a model of {self.inputs}."
            raise InputError("length-mismatch", said, fix="give (samples, inputs).")
        complete(u)
        if not (dt > 0 and finer >= 1):
            raise InputError("bad-option", f"dt={dt}, finer={finer}; above 0, and at least 1.")
        return u


def reactions(model: Feedback, laws: tuple[Numbers, ...], lines: Lines, Z: Any) -> Any:
    """W (channels, lines) to drives Z (channels, lines)."""
    z = lines.fine(Z)
    w = np.empty_like(z)
    for i, numbers in enumerate(laws):
        w[i] = settled(numbers, z[i], lines.step)[0]
        w[i] += model.levels[i] * z[i] * np.log(level_of(z[i]))
    return lines.coarse(w)


def settled(
    numbers: Numbers, z: Float[np.ndarray, " fine"], h: float
) -> tuple[Float[np.ndarray, " fine"], Int[np.ndarray, " rows"]]:
    """A law's output over a period z in steady state, and the rows of z that lead there from rest, of which
    the last period counts.

    They begin at the largest |z|, where what remembers reversals has the same state in every period. A law
    that comes back to another one runs two periods.
    """
    order = np.roll(np.arange(len(z)), -int(np.argmax(np.abs(z))))
    again, steps, w = np.roll(order, -1), np.full(len(z), h), np.empty(len(z))
    first = run(numbers, z[order[:1]], np.array([np.nan])).m
    once = run(numbers._replace(m=first), z[again], steps)
    if np.allclose(once.m, first, rtol=ROUNDING, atol=0.0):
        w[again] = once.value
        return w, order
    w[again] = run(numbers._replace(m=once.m), z[again], steps).value
    return w, np.tile(order, 2)


def level_of(z: np.ndarray) -> float:
    """s: the root mean square, not nothing."""
    return float(np.sqrt(max(np.mean(z * z), 1e-300)))


def steady_state(
    model: Feedback, lines: Lines, U: Any, Z: Any = None, G: Any = None, climb: bool = True
) -> Steady:
    """The steady state of inputs (lines, inputs), from drives Z on where they are known nearly."""
    G = model.response(lines.s) if G is None else G
    ny, nu, n = model.outputs, model.inputs, len(model.channels)
    linear = (G[:, :, :nu] @ U[:, :, None])[:, :, 0]
    if not n:
        none = np.zeros((0, len(U)), complex)
        return Steady(linear, none, none, 0.0)
    laws, own, loop = model.laws(), linear[:, ny:].T, G[:, ny:, nu:]
    Z, W, left = _fixed_point(model, laws, lines, own, loop, own if Z is None else Z)
    if climb and not left < 100 * CLOSE:
        drives = None
        for part in CLIMB:
            found = steady_state(model, lines, part * U, drives, G, climb=False)
            Z, W, left, drives = found.drives, found.reactions, found.left, found.drives
            if not left < 0.1:
                break
    return Steady(linear[:, :ny] + (G[:, :ny, nu:] @ W.T[:, :, None])[:, :, 0], Z, W, left)


def _fixed_point(
    model: Feedback, laws: tuple[Numbers, ...], lines: Lines, own: Any, loop: Any, Z: Any
) -> tuple[Any, Any, float]:
    """Z = own + loop W(Z), from a start."""
    n = len(own)
    best, here, kept = np.inf, (Z, None, None), None
    ways: list[tuple[Any, Any]] = []
    share, failed = 1.0, 0
    for _ in range(STEPS):
        with np.errstate(over="ignore", invalid="ignore"):  # a step too far is taken back
            W = reactions(model, laws, lines, Z)
        rest = own + (loop @ W.T[:, :, None])[:, :, 0].T - Z
        left = float(np.linalg.norm(rest) / max(np.linalg.norm(Z), 1e-300))
        if not left < 3 * best:  # astray: back to the best one, in shorter steps, without memory
            failed, share, kept, ways = failed + 1, share / 2, None, []
            if failed > FAILED or here[1] is None:
                break
            Z, W, rest = here
        elif left < best:
            best, here = left, (Z, W, rest)
        if best < CLOSE:
            break
        power = np.maximum((np.abs(Z) ** 2).sum(1), 1e-300)
        gain = (Z.conj() * W).sum(1) / power
        step = np.linalg.solve(np.eye(n) - loop * gain, rest.T[:, :, None])[:, :, 0].T
        if kept is not None:
            ways = [*ways, (Z - kept[0], step - kept[1])][-MIXED:]
        kept, new = (Z, step), Z + share * step
        if ways:
            F: Any = np.stack([f.ravel() for _, f in ways], 1)
            square = (F.conj().T @ F).real
            square += 1e-10 * np.trace(square) * np.eye(len(square))
            weights = np.linalg.solve(square, (F.conj().T @ step.ravel()).real)
            new = new - sum(w * (z + share * f) for w, (z, f) in zip(weights, ways, strict=True))
        Z = new
    return here[0], here[1], best
