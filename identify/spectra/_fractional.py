"""Fractional elements as a summary of a spectrum: a springpot's two numbers, a fractional Zener's four."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Complex, Float
from scipy.optimize import least_squares

from ._extrapolation import Allowed
from ._prony_series import Input, Kind

A_DECADE = 10
"""Frequencies at which an element is compared with its spectrum."""

Modulus = Complex[np.ndarray, " frequencies"]


class Fractional(NamedTuple):
    """A fractional element beside the spectrum that it sums up.

    - `name`: "springpot" or "fractional Zener". `names`: of its numbers.
    - `value`: of the fitted spectrum. `low`, `high`: over all spectra at the edge of what the rows allow
      with 90 % confidence.
    - `misfit`: rms of its complex modulus, relative to the spectrum's, over the frequencies of the rows.
    """

    name: str
    names: tuple[str, ...]
    value: Float[np.ndarray, " numbers"]
    low: Float[np.ndarray, " numbers"]
    high: Float[np.ndarray, " numbers"]
    misfit: float

    def __str__(self) -> str:
        each = zip(self.names, self.value, self.low, self.high, strict=True)
        said = ", ".join(f"{name} {x:.3g} ({low:.3g} to {high:.3g})" for name, x, low, high in each)
        return f"{self.name}: {said}; it is {100 * self.misfit:.2g} % off the spectrum"


def springpot(z: np.ndarray, omega: np.ndarray) -> Modulus:
    """V (i w)^alpha of z = (log V, alpha)."""
    return np.exp(z[0]) * (1j * omega) ** z[1]


def zener(z: np.ndarray, omega: np.ndarray) -> Modulus:
    """E_inf + (E_0 - E_inf) x / (1 + x), x = (i w tau)^alpha, of z = (log E_inf, log (E_0 - E_inf),
    log tau, logit alpha)."""
    x = (1j * omega * np.exp(z[2])) ** (1 / (1 + np.exp(-z[3])))
    return np.exp(z[0]) + np.exp(z[1]) * x / (1 + x)


def fractional_of(
    kind: Kind, allowed: Allowed, step: float, span: float
) -> tuple[Fractional, Fractional]:
    """Both elements, each nearest to the logarithm of the complex modulus of the first of these spectra."""
    omega = np.geomspace(1 / span, 1 / step, A_DECADE * max(int(np.log10(span / step)), 1))
    real, imaginary = np.hsplit(allowed.outputs(Input(kind, omega, oscillation=True)), 2)
    moduli = real + 1j * imaginary if kind == "relaxation" else 1 / (real - 1j * imaginary)
    size = np.log(np.abs(moduli[0]))
    alpha = np.polyfit(np.log(omega), size, 1)[0]
    middle = -float(np.mean(np.log(omega)))
    starts = [np.array([size.min() - 1, size.max(), middle, a]) for a in (-1.0, 0.0, 2.0)]
    pots = np.array([size.mean() + alpha * middle, alpha])
    return (
        _summed(springpot, ("V", "alpha"), [pots], moduli, omega),
        _summed(zener, ("E_inf", "E_0", "tau", "alpha"), starts, moduli, omega),
    )


def _summed(
    element: Callable[[np.ndarray, np.ndarray], Modulus],
    names: tuple[str, ...],
    starts: Sequence[np.ndarray],
    moduli: Complex[np.ndarray, "spectra frequencies"],
    omega: Float[np.ndarray, " frequencies"],
) -> Fractional:
    def nearest(start: np.ndarray, modulus: Modulus) -> Any:
        def off(z: np.ndarray) -> np.ndarray:
            apart = np.log(element(z, omega) / modulus)
            return np.append(np.real(apart), np.imag(apart))

        return least_squares(off, start, bounds=(start - 40, start + 40))

    best = min((nearest(start, moduli[0]) for start in starts), key=lambda found: found.cost).x
    each = [_numbers(names, nearest(best, modulus).x) for modulus in moduli]
    misfit = np.sqrt(np.mean(np.abs(element(best, omega) / moduli[0] - 1) ** 2))
    name = "springpot" if len(names) == 2 else "fractional Zener"
    return Fractional(
        name, names, _numbers(names, best), np.min(each, 0), np.max(each, 0), float(misfit)
    )


def _numbers(names: tuple[str, ...], z: np.ndarray) -> np.ndarray:
    if len(names) == 2:
        return np.array([np.exp(z[0]), z[1]])
    low, more, tau = np.exp(z[:3])
    return np.array([low, low + more, tau, 1 / (1 + np.exp(-z[3]))])
