"""The fit of a Burgers element that a Python user would write: lmfit, and a compiled recursion.

python -m benchmarks._scale.lmfit_burgers FILE [--leading]

FILE has the columns time, input, output and an even clock: force and displacement, or with `--leading`
displacement and force. The recursion is numba's where that is installed, else SciPy's `lfilter`; the first
line of the output says which. Parameters start where hysid's do, and are bounded below by zero.
"""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import lmfit
import numpy as np
from scipy.signal import lfilter

Recursion = Callable[[float, float, float, np.ndarray], np.ndarray]


def by_scipy(decay: float, before: float, now: float, u: np.ndarray) -> np.ndarray:
    """x_k = decay x_(k-1) + before u_(k-1) + now u_k, at rest before the first sample."""
    return lfilter([now, before], [1.0, -decay], u, zi=[-now * u[0]])[0]


def compiled() -> tuple[str, Recursion]:
    """The recursion, and the name of what compiled it."""
    try:
        # Only the extra `bench` has it.
        import numba  # pyright: ignore[reportMissingImports]
    except ImportError:
        return "SciPy lfilter", by_scipy

    @numba.njit(cache=True)
    def by_numba(decay: float, before: float, now: float, u: np.ndarray) -> np.ndarray:
        x = np.zeros(len(u))
        for k in range(1, len(u)):
            x[k] = decay * x[k - 1] + before * u[k - 1] + now * u[k]
        return x

    return f"numba {numba.__version__}", by_numba


def output(p: lmfit.Parameters, dt: float, u: np.ndarray, recursion: Recursion) -> np.ndarray:
    """Displacement of a Burgers element, exact for a force that is linear between samples."""
    values = p.valuesdict()
    x = dt * values["E2"] / values["eta2"]
    decay, phi = np.exp(-x), -np.expm1(-x) / x
    psi = (1 - phi) / x
    delayed = recursion(decay, dt / values["eta2"] * (phi - psi), dt / values["eta2"] * psi, u)
    flow = recursion(1.0, dt / 2 / values["eta1"], dt / 2 / values["eta1"], u)
    return u / values["E1"] + flow + delayed + values["offset"]


def leading(p: lmfit.Parameters, dt: float, u: np.ndarray) -> np.ndarray:
    """Force of the element under a displacement: the filter with its two polynomials exchanged."""
    values = p.valuesdict()
    x = dt * values["E2"] / values["eta2"]
    decay, phi = np.exp(-x), -np.expm1(-x) / x
    psi, flow = (1 - phi) / x, dt / 2 / values["eta1"]
    delayed = dt / values["eta2"] * np.array([psi, phi - psi])
    at_rest, relaxing = np.array([1.0, -1.0]), np.array([1.0, -decay])
    below = np.polymul(at_rest, relaxing)
    above = below / values["E1"] + flow * np.polymul([1.0, 1.0], relaxing)
    above += np.polymul(delayed, at_rest)
    return np.asarray(lfilter(below, above, u)) + values["offset"]


def fitted(file: Path, leads: bool) -> tuple[str, Any]:
    """The fit of a file, and what compiled its recursion."""
    t, u, y = np.loadtxt(file, delimiter=",", skiprows=1, unpack=True)
    words, recursion = compiled()
    dt, span, gain = (t[-1] - t[0]) / (len(t) - 1), t[-1] - t[0], np.ptp(y) / np.ptp(u)
    gain = 1 / gain if leads else gain
    start = {
        "E1": 1 / gain,
        "eta1": 3 / gain * span,
        "E2": 2 / gain,
        "eta2": 2 / gain * np.sqrt(dt * span),
    }
    parameters = lmfit.Parameters()
    for name, value in start.items():
        parameters.add(name, value, min=0.0)
    parameters.add("offset", 0.0)
    if leads:
        return "SciPy lfilter", lmfit.minimize(lambda p: leading(p, dt, u) - y, parameters)
    return words, lmfit.minimize(lambda p: output(p, dt, u, recursion) - y, parameters)


def main(arguments: list[str]) -> None:
    words, found = fitted(Path(arguments[0]), "--leading" in arguments)
    print(words)
    for name, value in found.params.valuesdict().items():
        print(f"{name}={float(value)!r}")
    print(f"mean_square={found.chisqr / found.ndata!r}")


if __name__ == "__main__":
    main(sys.argv[1:])
