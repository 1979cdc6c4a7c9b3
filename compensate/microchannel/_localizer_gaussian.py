"""Gaussian classifier: one normal distribution of channel ratios for each place; the force cancels."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.linalg import helmert

from hysteresis import register

_ROUNDS = 100
"""Of expectation and maximisation: 5 settle W where N is small beside it, 100 where N is as large."""


@register
@dataclass(frozen=True)
class Clouds:
    """Places as normal distributions of z = H ln V, H the contrasts that no common factor changes.

    A press of force F at place k reads V_l = S_lk f(F) p_l + e_l with a random placement p and noise e of
    deviation s, so that at any force

        z ~ N(m_k, W_k + N),    N = H diag(s^2/V_l^2) H'

    Light presses are noisier and count less, in training and after it. `mean` m (places, contrasts),
    `scatter` W (places, contrasts, contrasts), `weakest` and `strongest` ln V (places,), mean over the
    channels, of the presses seen; `noise` s (channels,).
    """

    mean: Float[np.ndarray, "places contrasts"]
    scatter: Float[np.ndarray, "places contrasts contrasts"]
    weakest: Float[np.ndarray, " places"]
    strongest: Float[np.ndarray, " places"]
    noise: Float[np.ndarray, " channels"]

    def distances(
        self, readings: Float[np.ndarray, "presses channels"]
    ) -> tuple[Float[np.ndarray, "presses places"], Float[np.ndarray, "presses places"]]:
        """Squared Mahalanobis distance of each press from each place, and the density's logarithm."""
        z, N = contrasts(readings, self.noise)
        spread = self.scatter + N[:, None]
        away = z[:, None] - self.mean
        squared = np.sum(away * np.linalg.solve(spread, away[..., None])[..., 0], axis=-1)
        volume = np.linalg.slogdet(2 * np.pi * spread)[1]
        return squared, -(squared + volume) / 2


def train_clouds(
    readings: Float[np.ndarray, "presses channels"],
    place: Int[np.ndarray, " presses"],
    noise: Float[np.ndarray, " channels"],
    shared: float,
) -> Clouds:
    """The likeliest clouds of presses at the places 0, 1, ..., each with two or more.

    Every W is drawn towards their mean over all presses, which weighs as much as `shared` presses of the
    place itself: places with few presses would otherwise look surer than they are.
    """
    z, N = contrasts(readings, noise)
    own = [place == k for k in range(place.max() + 1)]
    found = [_deconvolved(z[rows], N[rows]) for rows in own]
    mean, scatter = (np.stack(parts) for parts in zip(*found, strict=True))
    count = np.array([rows.sum() for rows in own], float)[:, None, None]
    pooled = np.sum(count * scatter, axis=0) / count.sum()
    part = count / (count + shared) if np.isfinite(shared) else 0.0
    # The mean of n presses is itself uncertain by W/n.
    scatter = (part * scatter + (1 - part) * pooled) * (1 + 1 / count)
    strength = np.log(_positive(readings, noise)).mean(axis=1)
    weakest, strongest = (np.array([f(strength[rows]) for rows in own]) for f in (np.min, np.max))
    return Clouds(mean, scatter, weakest, strongest, noise)


def contrasts(
    readings: Float[np.ndarray, "presses channels"], noise: Float[np.ndarray, " channels"]
) -> tuple[Float[np.ndarray, "presses c"], Float[np.ndarray, "presses c c"]]:
    """z and N of presses."""
    H, V = helmert(readings.shape[1]), _positive(readings, noise)
    return np.log(V) @ H.T, (H * (noise / V)[:, None] ** 2) @ H.T


def _positive(readings: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """Readings raised to at least their noise, because the logarithm of less carries no information."""
    return np.maximum(readings, np.maximum(noise, np.finfo(float).tiny))


def _deconvolved(z: np.ndarray, N: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Maximum-likelihood m and W of z_i ~ N(m, W + N_i).

    Source: Bovy, Hogg and Roweis, Annals of Applied Statistics 5 (2011), equations (14) to (16), with
    one component.
    """
    mean = z.mean(axis=0)
    # Its rounds multiply W and cannot leave 0: the least W is that of readings to six digits.
    least = 1e-12 * np.eye(z.shape[1])
    W = (z - mean).T @ (z - mean) / len(z) + least
    for _ in range(_ROUNDS if N.any() else 0):
        gain = np.linalg.solve(W + N, np.broadcast_to(W, N.shape)).swapaxes(-1, -2)
        latent = mean + (gain @ (z - mean)[..., None])[..., 0]
        mean = latent.mean(axis=0)
        left = latent - mean
        W = (left.T @ left + np.sum(W - gain @ W, axis=0)) / len(z) + least
    return mean, W
