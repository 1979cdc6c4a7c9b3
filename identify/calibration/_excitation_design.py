"""Experiment design for an oscillator: which level and band of a multisine tell its hysteresis."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from hysteresis import InputError, Oscillator, Sum
from hysteresis.dynamics._oscillator import forces_of

from .._levels import FEWEST, MUCH, SOME_ROWS, WHOLE
from ..dynamics._classes import COARSER, duhem_family, periods_to_steady_state
from ..dynamics._measured_motion import LEAST_ROWS, measured_motion
from ..dynamics._output_error import FAR, PLANT, STATE, Setting, covariance_of, hats
from ..results._detail import Motion
from ..results._fit_result import FitResult
from ._calibrate import prior_of

LEVELS = 2.0 ** np.arange(-2, 3)
"""Of the fitted record's rms force."""

BANDS = tuple((1 / f, f) for f in (MUCH, 2.0, 10.0))
"""About the resonance, by which they are multiplied; the fitted record's band is tried too."""

PLACES = 100
"""Forces at which the standard deviation of the slopes f+ and f- is taken."""


class Excitation(NamedTuple):
    """A multisine and what one period of it in steady state would tell.

    - `low`, `high`: its band, in cycles per unit of time. `level`: its rms force.
    - `hysteresis`: standard error of the slopes f+(z) and f-(z), rms over the forces z of the fitted
      record, relative to their rms. `mass`, `damping`, `stiffness`: relative standard errors.
    - `displacement`: the largest one. `beyond`: whether it is larger than any in the fitted record, where
      the prediction is an extrapolation.
    - `force`: one period of it.
    """

    low: float
    high: float
    level: float
    hysteresis: float
    mass: float
    damping: float
    stiffness: float
    displacement: float
    beyond: bool
    force: Float[np.ndarray, " samples"]


def multisine(
    low: float, high: float, level: float, *, rows: int, dt: float, seed: int = 0
) -> Float[np.ndarray, " rows"]:
    """One period of a multisine: all lines from `low` to `high` of one amplitude, with random phases.

    **Arguments:** `level`: its rms. `rows`: of a period, `dt` apart.

    Raises `InputError` `bad-option` for a band beyond the Nyquist frequency or of fewer than eight lines,
    or a level that is not positive.

    Source: Pintelon and Schoukens, System Identification: A Frequency Domain Approach (2012), chapter 2.

    **Example:**

        >>> force = identify.multisine(5.0, 50.0, 10.0, rows=1024, dt=1e-3)
        >>> round(float(np.sqrt(np.mean(force**2))), 6)
        10.0
    """
    frequencies = np.fft.rfftfreq(rows, dt)
    lines = (frequencies >= low) & (frequencies <= high) & (frequencies > 0)
    if not 0 <= low < high < 0.5 / dt or lines.sum() < FEWEST or not level > 0:
        raise InputError(
            "bad-option",
            f"a multisine of {level:g} rms from {low:g} to {high:g}: {int(lines.sum())} lines at a sampling"
            f" rate of {1 / dt:g}, {rows} rows a period.",
            fix=f"give a positive level, a band below {0.5 / dt:g}, and a period of so many rows that at"
            f" least {FEWEST} lines lie in it.",
        )
    phases = np.random.default_rng(seed).uniform(0, 2 * np.pi, int(lines.sum()))
    spectrum = np.zeros(len(frequencies), complex)
    spectrum[lines] = np.exp(1j * phases)
    found = np.fft.irfft(spectrum, rows)
    return found * level / float(np.sqrt(np.mean(found**2)))


def design_excitation(
    fit: FitResult,
    *,
    levels: Sequence[float] | None = None,
    bands: Sequence[tuple[float, float]] | None = None,
    rows: int | None = None,
    largest: float | None = None,
    seed: int = 0,
) -> tuple[Excitation, ...]:
    """Multisines by how well one period of each would tell the hysteresis of a fitted oscillator, the best
    one first.

        covariance = (J'J / sigma^2 + P)^-1

    with J the sensitivities of the displacement in steady state, sigma the noise of the fitted record, and
    P the prior of a class with many knots. Of n periods the standard errors are smaller by the root of n.

    **Arguments:**

    - `fit`: of an oscillator around Bouc-Wen's or Duhem's force.
    - `levels`: rms forces; a quarter to four times that of the fitted record unless given. `bands`: (low,
      high) in cycles per unit of time; several about the resonance unless given.
    - `rows`: of a period; those of the fitted record unless given.
    - `largest`: the largest displacement that the rig allows; multisines that exceed it are left out.

    Raises `InputError` `no-design` for another model or class, or where no multisine stays within
    `largest`; `bad-option` as `multisine` does.

    Source: Atkinson, Donev, Tobias, Optimum Experimental Designs, with SAS (2007).

    **Example:**

        >>> designs = identify.design_excitation(shaken_fit, levels=(20.0, 40.0), bands=[(5.0, 70.0)])
        >>> [one.level for one in designs]
        [40.0, 20.0]
    """
    detail, model = fit.detail, fit.model
    if not isinstance(detail, Motion) or not isinstance(model, Oscillator):
        raise InputError(
            "no-design",
            f"{fit.name} has no mass, so that no level and band of a multisine is sought for it.",
            fix="identify.design says which inputs tell the rest of a Preisach density.",
        )
    rate, _ = forces_of(model.hysteresis) or (None, None)
    if rate is None or isinstance(model.hysteresis, Sum):
        raise InputError(
            "no-design",
            f"the hysteresis of {fit.name} has no slopes over its force.",
            fix="fit Oscillator(BoucWen) or Oscillator(Duhem) to the same record, and design by that.",
        )
    motion = measured_motion(fit.train, detail.recorded.period)
    knots, limit = len(rate.rising), float(rate.limit)
    words = detail.classes[0]
    family = duhem_family(knots, limit, bool(words.get("symmetric", True)), False)
    plant = float(model.mass), float(model.damping), float(model.stiffness)
    theta = np.concatenate([plant, np.zeros(STATE), rate.rising, rate.falling])
    q = family.unknowns_of(theta)
    prior = np.diag(family.prior_root(words.get("deviations", ())) ** 2)
    warm = periods_to_steady_state(motion, detail.linear)
    z = Setting.of(motion, detail.recorded.substeps, (), warm).hysteretic_force(family, q)
    slopes = np.kron(np.eye(2), hats(np.linspace(z.min(), z.max(), PLACES), limit, knots))
    slopes = slopes @ family.T[PLANT + STATE :]
    size = float(np.sqrt(np.mean((slopes @ q) ** 2)))
    rows = rows or (motion.period or SOME_ROWS)
    if rows < LEAST_ROWS:
        raise InputError("bad-option", f"a period of {rows} rows.", fix=f"at least {LEAST_ROWS}.")
    usual = float(np.sqrt(np.mean((motion.force - motion.force.mean()) ** 2)))
    substeps = max(1, detail.recorded.substeps // COARSER)
    trained, found = float(np.abs(motion.displacement).max()), []
    for low, high in _bands(detail, motion.dt) if bands is None else bands:
        for level in levels if levels is not None else [part * usual for part in LEVELS]:
            force = multisine(low, high, level, rows=rows, dt=motion.dt, seed=seed)
            turns = periods_to_steady_state(motion, detail.linear, rows)
            setting = Setting.of(replace(motion, force=force, period=rows), substeps, (), turns)
            first = turns * len(setting.force)
            y, by = family.moved(q, *setting.rows, kept=(first, substeps))
            reach = float(np.abs(y[first:]).max())
            stable = np.abs(y).max() < FAR * trained * max(1.0, level / usual)
            if not stable or reach > (np.inf if largest is None else largest):
                continue
            J = by / fit.noise.sigma
            spread = covariance_of(J.T @ J + prior)
            error = float(np.sqrt(np.mean(np.einsum("pi,ij,pj->p", slopes, spread, slopes))))
            mass, damping, stiffness = map(float, np.sqrt(np.diag(spread)[:3]) / np.abs(q[:3]))
            errors, far = (error / size, mass, damping, stiffness), reach > 1.05 * trained
            found.append(Excitation(low, high, float(level), *errors, reach, far, force))
    if not found:
        raise InputError(
            "no-design",
            "no multisine keeps the displacement within the limit."
            if largest is not None
            else "the fitted oscillator is unstable under every multisine.",
            fix="give lower levels, or a larger displacement.",
        )
    return tuple(sorted(found, key=lambda one: one.hysteresis))


def _bands(detail: Motion, dt: float) -> list[tuple[float, float]]:
    """The fitted record's band, and those about the resonance, below the Nyquist frequency."""
    linear, top = detail.linear, WHOLE / 2 / dt
    own = (float(linear.frequencies[0]), min(float(linear.frequencies[-1]), top))
    about = [(a * linear.resonance, min(b * linear.resonance, top)) for a, b in BANDS]
    return [own, *(band for band in about if band[0] < band[1])]


# Optimal experimental design: pick the measurements that most reduce the variance of the goals.

System = TypeVar("System", bound=eqx.Module)


class Choice(NamedTuple):
    """Candidate measurements in the order in which they were chosen.

    - `chosen`: indices of the candidates; one that appears twice is a measurement to repeat.
    - `expected`: root mean square standard deviation of the goals after none, one, two, ... of them.
    """

    chosen: Int[np.ndarray, " count"]
    expected: Float[np.ndarray, " count_1"]


def choose(
    system: System,
    residuals: Callable[[System], Array],
    goals: Callable[[System], Array],
    deviations: Mapping[str, Any],
    count: int,
) -> Choice:
    """Choose `count` of many possible measurements for a calibration, one after the other (A-optimal).

    Each step takes the candidate c that leaves the least total variance of the goals,

        trace(G S G'),      S = (1 + sum over the chosen of J_c'J_c)^-1,

    with J_c the Jacobian of its residuals and G that of the goals, in the unconstrained space of
    `calibrate`. Nothing needs to have been measured: J and G are taken at `system`, which must be near
    enough to the truth.

    **Arguments:**

    - `system`: a Module with the values expected before the measurements.
    - `residuals`: function of a system; returns (candidates, ...), divided by the noise's standard
      deviation, as for `calibrate`.
    - `goals`: function of a system; returns an array of any shape, the quantities to be known.
    - `deviations`: prior standard deviations by name, as for `calibrate`.
    - `count`: how many measurements to choose.

    Raises `InputError` `bad-option` if `count` is less than one, and as `calibrate` for the deviations.

    Source: Atkinson, Donev, Tobias, Optimum Experimental Designs, with SAS (2007), chapter 10.

    In the example: which force tells most about the stiffness of a line?
    """
    if count < 1:
        raise InputError(
            "bad-option", f"{count} measurements cannot be chosen.", fix="ask for one or more."
        )
    prior = prior_of(system, deviations)
    start = jnp.zeros(len(prior.names))

    @eqx.filter_jit
    def jacobians(prior: Any) -> tuple[Array, Array]:
        of_rows = jax.jacfwd(lambda z: residuals(prior.at(z)))(start)
        rows = of_rows.reshape(len(of_rows), -1, len(start))
        wanted = jax.jacfwd(lambda z: jnp.ravel(goals(prior.at(z))))(start)
        return jnp.einsum("crj,crk->cjk", rows, rows), wanted

    information, G = map(np.asarray, jacobians(prior))
    values, vectors = np.linalg.eigh(information)
    roots = np.sqrt(np.maximum(values, 0))[..., None] * np.swapaxes(vectors, 1, 2)
    S, chosen = np.eye(len(start)), []
    expected = [np.sum((G @ S) * G)]
    for _ in range(count):
        B = roots @ S
        gains = np.linalg.solve(B @ np.swapaxes(roots, 1, 2) + np.eye(len(start)), B)
        lost = np.einsum("cjk,cjl,gk,gl->c", B, gains, G, G, optimize=True)
        best = int(np.argmax(lost))
        S = S - B[best].T @ gains[best]
        chosen.append(best)
        expected.append(np.sum((G @ S) * G))
    return Choice(np.array(chosen), np.sqrt(np.maximum(expected, 0) / len(G)))
