"""The FORC diagram: a material's density directly from its first-order reversal curves."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from hysteresis import InputError

from ._curves import Forc, check_curves


class ForcDiagram(NamedTuple):
    """The density at the measured points where enough neighbours were measured.

    - `reversal`, `input` (points,): b and u; thresholds beta and alpha of the relays that switch there.
    - `density`: rho = -1/2 d^2 y / (db du), in output / input^2.
    - `standard_error`: of the density, from the residuals of its local fit as if they were independent.
    """

    reversal: Float[np.ndarray, " points"]
    input: Float[np.ndarray, " points"]
    density: Float[np.ndarray, " points"]
    standard_error: Float[np.ndarray, " points"]

    @property
    def coercivity(self) -> Float[np.ndarray, " points"]:
        """(u - b) / 2: half the width of a relay's loop."""
        return (self.input - self.reversal) / 2

    @property
    def bias(self) -> Float[np.ndarray, " points"]:
        """(u + b) / 2: where a relay's loop is centred."""
        return (self.input + self.reversal) / 2


def forc_diagram(curves: tuple[Forc, ...], smoothing: int = 3) -> ForcDiagram:
    """The density rho = -1/2 d^2 y / (db du) at every measured point, by a local quadratic surface.

    Around each point (b0, u0) the surface

        y = a0 + a1 B + a2 B^2 + a3 U + a4 U^2 + a5 B U,      B = b - b0, U = u - u0

    is fitted by least squares to (2 smoothing + 1)^2 neighbours: 2 smoothing + 1 curves, and on each of
    them as many samples around u0; spacings need not be even. Then rho = -a5 / 2. Where the surface is not
    quadratic the error grows as smoothing^2; the effect of noise falls as smoothing^-3. Points with fewer
    than half of their neighbours measured are excluded.

    **Arguments:**

    - `curves`: from `forc_curves`, each reversal once.
    - `smoothing`: the smoothing factor SF, 1 or more.

    Raises `InputError` `bad-option`, `too-few-curves`, `too-few-rows`, `not-increasing`.

    Source: Pike, Roberts, Verosub, Characterizing interactions in fine magnetic particle systems
    using first order reversal curves, J. Appl. Phys. 85 (1999).

    **Example:**

        >>> diagram = identify.forc_diagram(curves, smoothing=1)
        >>> diagram.density.shape == diagram.standard_error.shape == diagram.bias.shape
        True
    """
    if smoothing < 1:
        raise InputError(
            "bad-option", f"a smoothing of {smoothing} is too small.", fix="give 1 or more."
        )
    width = 2 * smoothing + 1
    check_curves(curves, width)
    if max(len(curve.input) for curve in curves) < width:
        raise InputError(
            "too-few-rows",
            f"no curve has the {width} samples that a smoothing of {smoothing} needs.",
            fix="smooth less, or measure more samples a curve.",
        )
    padded = [_padded(curve, width) for curve in curves]
    parts = []
    for k, curve in enumerate(curves):
        near = slice(max(k - smoothing, 0), k + smoothing + 1)
        b, u, y, there = _neighbours(curves[near], padded[near], curve.input, smoothing)
        enough = there.sum(1) > max(width**2 / 2, 6)
        fitted = _mixed_coefficient(
            b[enough] - curve.reversal, u[enough] - curve.input[enough, None],
            y[enough], there[enough],
        )  # fmt: skip
        at = curve.input[enough]
        parts.append([np.full_like(at, curve.reversal), at, -fitted[0] / 2, fitted[1] / 2])
    return ForcDiagram(*(np.concatenate(part) for part in zip(*parts, strict=True)))


def _padded(curve: Forc, width: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Input, output and whether measured, with `width` places more at either end, evenly spaced.

    A window near an end then finds padding instead of samples that lie further in.
    """
    u, more = curve.input, np.arange(1, width + 1)
    below, above = u[0] - (u[1] - u[0]) * more[::-1], u[-1] + (u[-1] - u[-2]) * more
    measured = np.zeros(len(u) + 2 * width, bool)
    measured[width:-width] = True
    return np.concatenate([below, u, above]), np.pad(curve.output, width), measured


def _neighbours(
    curves: tuple[Forc, ...],
    padded: list[tuple[np.ndarray, np.ndarray, np.ndarray]],
    centre: Float[np.ndarray, " points"],
    smoothing: int,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Reversal, input, output and whether measured of the samples of `curves` about each centre."""
    found = []
    step = np.arange(-smoothing, smoothing + 1)
    for curve, (u, y, measured) in zip(curves, padded, strict=True):
        nearest = np.searchsorted((u[1:] + u[:-1]) / 2, centre)
        rows = np.clip(nearest[:, None] + step, 0, len(u) - 1)
        found.append((np.full(rows.shape, curve.reversal), u[rows], y[rows], measured[rows]))
    b, u, y, there = (np.concatenate(part, 1) for part in zip(*found, strict=True))
    return b, u, y, there


def _mixed_coefficient(
    B: Float[np.ndarray, "points neighbours"],
    U: Float[np.ndarray, "points neighbours"],
    y: Float[np.ndarray, "points neighbours"],
    there: Bool[np.ndarray, "points neighbours"],
) -> tuple[Float[np.ndarray, " points"], Float[np.ndarray, " points"]]:
    """The coefficient of B U in each point's quadratic surface, and its standard error."""
    # In units of the window's half width the normal equations are well conditioned.
    size_b, size_u = (np.abs(x * there).max(1, keepdims=True) for x in (B, U))
    B, U = B / size_b, U / size_u
    A = np.stack([np.ones_like(B), B, B**2, U, U**2, B * U], -1) * there[..., None]
    y = np.where(there, y - y.mean(1, keepdims=True), 0.0)
    covariance = np.linalg.inv(np.swapaxes(A, 1, 2) @ A)
    at = (covariance @ (np.swapaxes(A, 1, 2) @ y[..., None]))[..., 0]
    residual = y - (A @ at[..., None])[..., 0]
    variance = (residual**2).sum(1) / (there.sum(1) - 6)
    unit = (size_b * size_u)[:, 0]
    return at[:, 5] / unit, np.sqrt(variance * covariance[:, 5, 5]) / unit
