"""The best linear approximation: mass, damping and stiffness, and how far from linear a record is."""

from typing import Any, NamedTuple, TypeAlias

import numpy as np
import scipy
from jaxtyping import Complex, Float

from hysteresis import InputError

from .._levels import FEW, HELD, LITTLE
from ._measured_motion import MeasuredMotion
from ._periodic_tests import excited_lines, linear_response
from ._vector_fitting import real

Lines: TypeAlias = Complex[np.ndarray, " lines"] | Any
"""A complex number of each line."""

PASSES = 10


class LinearApproximation(NamedTuple):
    """The best linear approximation of an oscillator.

    - `mass`, `damping`, `stiffness`: of m y'' + c y' + k y = u, the error of y least.
    - `frequencies`, `response`: (lines,) the frequency response y / u in the excited lines.
    - `noise`, `distortion`: (lines,) standard deviations of the response by noise, from the scatter of the
      periods, and by all that is not smooth in frequency: nonlinear distortion and noise together. NaN
      where the record has not two periods.
    """

    mass: float
    damping: float
    stiffness: float
    frequencies: Float[np.ndarray, " lines"]
    response: Lines
    noise: Float[np.ndarray, " lines"]
    distortion: Float[np.ndarray, " lines"]

    def model(self, frequencies: Float[np.ndarray, " lines"]) -> Lines:
        """y / u of the three parameters."""
        w = 2 * np.pi * frequencies
        return 1 / (-self.mass * w**2 + 1j * self.damping * w + self.stiffness)

    @property
    def resonance(self) -> float:
        """Frequency of the undamped resonance; 0 where mass or stiffness is not positive."""
        ratio = self.stiffness / self.mass if self.mass else 0.0
        return float(np.sqrt(ratio) / (2 * np.pi)) if ratio > 0 else 0.0


def linear_approximation(motion: MeasuredMotion) -> LinearApproximation:
    """Least squares over the excited lines, each weighted by the response of the last pass.

    A record without a period gets two more unknowns: what its ends add to the spectrum of a derivative.

    Raises `InputError` `no-excitation` where the record does not show a mass on a spring.
    """
    U, Y = np.fft.rfft(motion.force), np.fft.rfft(motion.displacement)
    w = 2 * np.pi * motion.frequencies
    lines = excited_lines(U[None, :, None], LITTLE if motion.periodic else HELD)
    if len(lines) < 4:
        raise InputError(
            "no-excitation",
            f"the force has {len(lines)} frequencies; mass, damping and stiffness need more.",
            fix="excite with a multisine, a sweep or noise about the resonance.",
        )
    columns = [-(w**2) * Y, 1j * w * Y, Y]
    if not motion.periodic:
        columns += [np.ones_like(Y), 1j * w]
    A, weight = np.column_stack(columns)[lines], np.ones(len(lines))
    found = np.zeros(len(columns))
    for _ in range(PASSES):
        scaled, right = A * weight[:, None], U[lines] * weight
        size = np.sqrt((np.abs(scaled) ** 2).sum(0))
        found = np.linalg.lstsq(real(scaled) / size, real(right), rcond=None)[0] / size
        weight = 1 / np.abs(-found[0] * w[lines] ** 2 + 1j * found[1] * w[lines] + found[2])
    f, response = motion.frequencies[lines], Y[lines] / U[lines]
    noise = np.full(len(f), np.nan)
    if motion.scatter is not None:
        noise = np.sqrt(motion.scatter[lines]) / np.abs(U[lines])
    distortion = np.full(len(f), np.nan)
    if motion.periodic:
        _, left, free = linear_response(U[None, :, None], Y[None, :, None], lines, 1)
        power = np.abs(left[0, :, 0] / U[lines]) ** 2 / free
        distortion = np.sqrt(scipy.ndimage.uniform_filter1d(power, FEW, mode="nearest"))
    m, c, k = (float(x) for x in found[:3])
    linear = LinearApproximation(m, c, k, f, response, noise, distortion)
    _check(linear)
    return linear


def _check(linear: LinearApproximation) -> None:
    f, at = linear.frequencies, linear.resonance
    if linear.mass > 0 and linear.stiffness > 0 and f[0] <= at <= f[-1]:
        return
    seen = f"a resonance at {at:.4g}" if at else "no resonance"
    raise InputError(
        "no-excitation",
        f"the force excites {f[0]:.4g} to {f[-1]:.4g} cycles per unit of time; the best linear fit has"
        f" there the mass {linear.mass:.3g}, the stiffness {linear.stiffness:.3g} and {seen}.",
        cause="the force never excites the resonance, the columns are exchanged, or another unit.",
        fix="excite a band about the resonance; --input is the force, --output the displacement.",
    )
