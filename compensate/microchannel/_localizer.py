"""Localisation: the pressed place of a soft sensor, from the readings of its few channels."""

from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from enum import IntEnum
from itertools import permutations
from typing import NamedTuple

import numpy as np
import scipy
from jaxtyping import Float, Int
from numpy.typing import ArrayLike
from scipy.linalg import helmert

from hysteresis import InputError, register
from hysteresis._show import aligned

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


@register
@dataclass(frozen=True)
class Neighbours:
    """k nearest neighbours among the training presses, by the readings' Euclidean distance.

    Places with more training presses have more neighbours: the counts act as priors.

    Source: Kim and Park (2018), section III.B; their k is not printed.
    """

    readings: Float[np.ndarray, "presses channels"]
    place: Int[np.ndarray, " presses"]
    neighbours: int

    def probabilities(
        self, readings: Float[np.ndarray, "presses channels"]
    ) -> Float[np.ndarray, "presses places"]:
        """The part of the neighbours at each place."""
        ranks = range(1, self.neighbours + 1)
        nearest = scipy.spatial.KDTree(self.readings).query(readings, ranks)[1]
        return (self.place[nearest][..., None] == np.unique(self.place)).mean(axis=1)


LEAST_PRESSES = 3
"""Of a place, from which its scatter can be told at all."""


class PlaceStatus(IntEnum):
    """What a place is worth. Only the first is to be used without a thought."""

    OK = 0
    NO_PRESS = 1
    """All channels are within the noise: nothing is pressed, or too lightly to tell."""
    UNKNOWN = 2
    """Unlike the presses of any place: another place, several at once, or channels swapped."""
    BEYOND = 3
    """Weaker or stronger than any press seen at that place."""
    INVALID = 4
    """A channel was NaN or infinite."""


class Located(NamedTuple):
    """Of presses: the likeliest place and how sure that is."""

    place: Int[np.ndarray, " presses"]
    """index into `names`, -1 where the status is NO_PRESS, UNKNOWN or INVALID"""
    probability: Float[np.ndarray, "presses places"]
    """of each place, given that it is one of them; 0 with NO_PRESS and INVALID"""
    distance: Float[np.ndarray, " presses"]
    """squared Mahalanobis distance from the nearest place; chi-squared at a known place"""
    status: Int[np.ndarray, " presses"]
    """`PlaceStatus`"""


@dataclass(frozen=True)
class Confusion:
    """How often presses at each place (rows) were taken for each (columns); the last is for none."""

    names: tuple[Hashable, ...]
    counts: Int[np.ndarray, "places estimates"]

    @property
    def accuracy(self) -> float:
        """The part of all presses whose place was found."""
        return float(np.trace(self.counts) / self.counts.sum())

    def __str__(self) -> str:
        """As the paper prints it: nothing for zero."""
        head = ["Ref\\Est.", *map(str, self.names), "none"]
        rows = [
            [str(name), *("" if n == 0 else str(n) for n in row)]
            for name, row in zip(self.names, self.counts, strict=True)
        ]
        return "\n".join(aligned([head, *rows], range(1, len(head))))


@register
@dataclass(frozen=True)
class Localizer:
    """Estimates from one reading of each channel which place is pressed, at any force.

    There are two methods, see `train`:

    - "gaussian": each place has a normal distribution of the channels' log ratios, from which the force
      cancels; the probabilities follow from Bayes's theorem, P(k | z) ~ prior_k N(z; m_k, W_k + N).
    - "neighbours": the paper's k nearest neighbours; the probabilities are votes.

    Both reject a press that is unlike those of the training, by its Mahalanobis distance from every place.

    **Example:**

        >>> found = compensate.microchannel.Localizer.train(presses.reading, presses.location)
        >>> found.locate(presses.reading[::40]).place.tolist()
        [0, 2, 4]
    """

    names: tuple[Hashable, ...]
    presses: tuple[int, ...]
    priors: Float[np.ndarray, " places"]
    clouds: Clouds
    neighbours: Neighbours | None
    reject: float
    least: float

    @classmethod
    def train(
        cls,
        readings: ArrayLike,
        places: Sequence[Hashable] | np.ndarray,
        *,
        method: str = "gaussian",
        names: Sequence[Hashable] | None = None,
        noise: ArrayLike = 0.0,
        priors: Sequence[float] | str = "equal",
        neighbours: int = 5,
        shared: float = 10.0,
        reject: float = 1e-3,
        least: float | None = None,
    ) -> "Localizer":
        """From presses whose places are known.

        **Arguments:**

        - `readings`: (presses, channels), two channels or more, in any unit; no press reads 0.
        - `places`: (presses,), the place of each: names or numbers.
        - `method`: "gaussian" or "neighbours".
        - `names`: the places there are, in their order; those that occur unless given.
        - `noise`: standard deviation of a reading, in its unit; one for all channels or one for each.

        **Other arguments:**

        - `priors`: of the places, for "gaussian": "equal", "counts" as in the training, or numbers. How
          often a place was pressed in training says nothing about later, unless you say so.
        - `neighbours`: k.
        - `shared`: how many presses' weight the mean scatter of all places has in each; inf: all share one.
        - `reject`: the part of presses at known places that may at most be taken for unknown.
        - `least`: a press is one where some channel reads more; five times the noise unless given.

        **Raises:** `InputError` where shapes differ, a reading is not finite, a named place has fewer
        than 3 presses or none, and a place is not named.
        """
        if method not in ("gaussian", "neighbours"):
            raise _fault(f"no method {method!r}.", '"gaussian" or "neighbours".')
        readings, places = np.asarray(readings, float), np.asarray(places)
        names = tuple(np.unique(places).tolist() if names is None else names)
        place = _indices(readings, places, names)
        counts = np.bincount(place, minlength=len(names))
        _check_counts(counts, names)
        noise = np.broadcast_to(np.asarray(noise, float), readings.shape[1:]).copy()
        if not np.all(noise >= 0):
            raise _fault(f"a noise of {noise}.", "0 or more, in the unit of the readings.")
        if not (0 <= reject < 1 and shared >= 0 and 1 <= neighbours <= len(place)):
            raise _fault(
                f"reject = {reject}, shared = {shared}, neighbours = {neighbours}.",
                "reject in [0, 1), shared 0 or more, neighbours from 1 to the number of presses.",
            )
        voters = Neighbours(readings, place, neighbours) if method == "neighbours" else None
        least = 5 * float(noise.max()) if least is None else least
        clouds = train_clouds(readings, place, noise, shared)
        presses, parts = tuple(counts.tolist()), _priors(priors, counts)
        return cls(names, presses, parts, clouds, voters, reject, least)

    def locate(self, readings: ArrayLike) -> Located:
        """Places of presses (presses, channels). Never raises for what the readings say."""
        z = np.asarray(readings, float)
        if z.ndim != 2 or z.shape[1] != len(self.clouds.noise):
            raise _fault(
                f"readings of shape {z.shape}.",
                f"(presses, {len(self.clouds.noise)}); NaN for a channel that has failed.",
            )
        finite = np.all(np.isfinite(z), axis=1)
        pressed = finite & (np.where(finite[:, None], z, 0.0) > self.least).any(axis=1)
        # What is no press is looked at as some press, and overwritten below.
        sound = np.where(pressed[:, None], z, 1.0)
        squared, density = self.clouds.distances(sound)
        if self.neighbours is None:
            with np.errstate(divide="ignore"):
                probability = scipy.special.softmax(np.log(self.priors) + density, axis=1)
        else:
            probability = self.neighbours.probabilities(sound)
        probability = np.where(pressed[:, None], probability, 0.0)
        place, distance = probability.argmax(axis=1), squared.min(axis=1)
        known = distance <= scipy.stats.chi2.isf(self.reject, len(self.clouds.noise) - 1)
        strength = np.log(np.maximum(sound, np.finfo(float).tiny)).mean(axis=1)
        seen = (self.clouds.weakest[place] <= strength) & (strength <= self.clouds.strongest[place])
        faults = [~finite, ~pressed, ~known, ~seen]
        _, no_press, unknown, beyond, invalid = map(int, PlaceStatus)
        status = np.select(faults, [invalid, no_press, unknown, beyond], int(PlaceStatus.OK))
        place = np.where(pressed & known, place, -1)
        return Located(place, probability, np.where(pressed, distance, np.nan), status)

    def confusion(self, readings: ArrayLike, places: Sequence[Hashable] | np.ndarray) -> Confusion:
        """Of presses whose places are known."""
        truth = _indices(np.asarray(readings, float), np.asarray(places), self.names)
        counts = np.zeros((len(self.names), len(self.names) + 1), int)
        np.add.at(counts, (truth, self.locate(readings).place), 1)  # -1 is the last column
        return Confusion(self.names, counts)

    def channel_order(
        self, readings: ArrayLike, places: Sequence[Hashable] | np.ndarray
    ) -> tuple[int, ...]:
        """The order of the channels in which presses at known places are likeliest, from 0.

        (0, 1, ...) when all is well; anything else says which wires were swapped: `readings[:, order]`
        puts them right. Press places that differ: a mirrored pair alone cannot tell.
        """
        readings = np.asarray(readings, float)
        truth = _indices(readings, np.asarray(places), self.names)
        rows = np.arange(len(truth))

        def likelihood(order: tuple[int, ...]) -> float:
            return float(self.clouds.distances(readings[:, order])[1][rows, truth].sum())

        return max(permutations(range(readings.shape[1])), key=likelihood)

    def doubts(self) -> tuple[str, ...]:
        """What about the training speaks against trusting the places, in words; mostly nothing."""
        counts = dict(zip(self.names, self.presses, strict=True))
        few = [f"{name} has {n} presses only" for name, n in counts.items() if n < 20]
        low, high = min(counts, key=counts.__getitem__), max(counts, key=counts.__getitem__)
        if self.neighbours is not None and counts[high] > 1.5 * counts[low]:
            few.append(
                f"{high} has {counts[high]} presses and {low} {counts[low]}: votes lean towards {high}"
            )
        return tuple(few)


def _indices(readings: np.ndarray, places: np.ndarray, names: tuple[Hashable, ...]) -> np.ndarray:
    if readings.ndim != 2 or readings.shape[1] < 2 or places.shape != readings.shape[:1]:
        raise _fault(
            f"readings of shape {readings.shape}, places of {places.shape}.",
            "(presses, channels) with two channels or more, and (presses,).",
        )
    bad = np.flatnonzero(~np.isfinite(readings).all(axis=1))
    if bad.size:
        raise _fault(f"press {bad[0]} reads {readings[bad[0]]}.", "leave such presses out.")
    index = {name: k for k, name in enumerate(names)}
    unnamed = sorted(set(places.tolist()) - set(index), key=str)
    if unnamed:
        raise InputError(
            "unknown-place", f"{unnamed[0]!r} is none of the places {', '.join(map(str, names))}.",
            place="Localizer", fix="name all places, or mend the label.",
        )  # fmt: skip
    return np.array([index[p] for p in places.tolist()], int)


def _check_counts(counts: np.ndarray, names: tuple[Hashable, ...]) -> None:
    if len(names) < 2:
        raise _fault(f"{len(names)} place: there is nothing to tell apart.", "press two or more.")
    for name, count in zip(names, counts, strict=True):
        if count < LEAST_PRESSES:
            raise InputError(
                "too-few-presses", f"{count} training presses at {name}.", place="Localizer",
                cause="a file left out, or a label misspelt.",
                fix=f"press it {LEAST_PRESSES} times or more, better 100; or leave it out of names.",
            )  # fmt: skip


def _priors(priors: Sequence[float] | str, counts: np.ndarray) -> Float[np.ndarray, " places"]:
    if isinstance(priors, str):
        if priors not in ("equal", "counts"):
            raise _fault(f"no priors {priors!r}.", '"equal", "counts", or a number for each place.')
        values = counts.astype(float) if priors == "counts" else np.ones(len(counts))
    else:
        values = np.asarray(priors, float)
    if values.shape != counts.shape or not (np.all(values >= 0) and 0 < values.sum() < np.inf):
        raise _fault(f"priors {priors}.", "a number of 0 or more for each place.")
    return values / values.sum()


def _fault(problem: str, fix: str) -> InputError:
    return InputError("bad-option", problem, place="Localizer", fix=fix)
