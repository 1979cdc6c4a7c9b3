"""Whether residuals are white, and whether they still follow the input."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
import scipy
from jaxtyping import Bool, Float, Int

from hysteresis import Record

from .._levels import CHANCE
from ..noise._model import rows_of
from ..results._fit_result import FitResult


class Correlation(NamedTuple):
    """Correlation of residuals with something else, lag by lag.

    - `lags`: rows by which the other precedes the residual; below 0 it comes later.
    - `values` beyond `band` at one lag with `CHANCE` where there is none; beyond `family` at any lag.
    """

    lags: Int[np.ndarray, " lags"]
    values: Float[np.ndarray, " lags"]
    band: float
    family: float

    @property
    def worst(self) -> tuple[int, float] | None:
        """Lag and value of the correlation farthest beyond `family`, None where all lie within; of
        several about as far the one at the shortest lag."""
        size = np.abs(self.values)
        far = np.flatnonzero((size > self.family) & (size > 0.9 * size.max()))
        if not len(far):
            return None
        k = far[np.argmin(np.abs(self.lags[far]))]
        return int(self.lags[k]), float(self.values[k])


class Whiteness(NamedTuple):
    """What structure the residuals of a fit still have.

    - `itself`: their autocorrelation from lag 1 on; `ljung_box`, `p_value`: of all its lags together.
    - `input`, `speed`: correlation with the input, and with its increments over time, None where it has
      none.
    - `said`: what lies outside, in sentences; the first one is about `itself`.
    """

    itself: Correlation
    ljung_box: float
    p_value: float
    input: Correlation
    speed: Correlation | None
    said: tuple[str, ...]

    @property
    def white(self) -> bool:
        """Nothing lies outside."""
        return self.p_value > CHANCE and not any(
            c.worst for c in (self.input, self.speed) if c is not None
        )


def whiteness(fit: FitResult) -> Whiteness:
    """Judge the residuals of the fitted rows: one-step-ahead errors under the fit's noise model where it
    has one, else the residuals as they are.

    With c_k the sum of the products of residuals k rows apart inside a sequence, N_k their number, N = N_0:

        rho_k = c_k / c_0,      Ljung-Box  Q = N (N + 2) sum rho_k^2 / N_k,

    chi-square with as many degrees of freedom as lags, less the noise model's phi and theta. The mean is
    left in: an offset is an error. Input and speed, their means taken away, pass the filter that whitens
    the residuals: so the correlation is, but for its size, the gradient of the likelihood in a term that
    adds the input k rows ago to the output, and has the deviation 1 / sqrt(N_k) where there is no such
    term, whatever the input's own rhythm.

    Source: Ljung, Box, On a measure of lack of fit in time series models, Biometrika 65 (1978); Ljung,
    System Identification, 2nd ed., section 16.6.

    **Example:**

        >>> white = identify.whiteness(fit)
        >>> white.white
        False
        >>> white.itself.lags[:3].tolist()
        [1, 2, 3]
    """
    train, used = fit.train, fit.used
    r, noise = innovations(fit), fit.noise_model
    most = lags_of(fit.noise.correlation_time, train, used)
    products, pairs = _products(r, r, used, train.starts, np.arange(most + 1))
    with np.errstate(invalid="ignore", divide="ignore"):
        rho = np.nan_to_num(products[1:] / products[0])
        count = np.maximum(pairs[1:], 1)
        box = float(pairs[0] * (pairs[0] + 2) * np.sum(rho**2 / count))
    taken = sum(x is not None for x in (noise.phi, noise.theta)) if noise is not None else 0
    p_value = float(scipy.special.chdtrc(most - taken, box))
    itself = Correlation(np.arange(1, most + 1), rho, *_bands(int(pairs[0]), most))

    lags = np.arange(-(most // 4), most + 1)
    signals = {"input": train.input, "speed": speed(train)}
    found: dict[str, Correlation | None] = {}
    for name, signal in signals.items():
        signal = signal - signal[used].mean()
        e, x = r, innovations(fit, signal)
        if noise is None:
            e, x = _whitened((r, np.where(used, signal, 0.0)), used, train.starts)
        found[name] = _cross(e, x, used, train.starts, lags)
    by_input, by_speed = found["input"], found["speed"]
    assert by_input is not None  # an input that never changes is refused by the fit
    said = [_itself_in_words(itself, p_value)]
    said += _input_in_words(by_input) + _speed_in_words(by_speed, train, used)
    return Whiteness(itself, box, p_value, by_input, by_speed, tuple(said))


def innovations(
    fit: FitResult, signal: Float[np.ndarray, " rows"] | None = None
) -> Float[np.ndarray, " rows"]:
    """The residuals, or another signal, through the filter that makes the noise white and of unit size;
    without a noise model it only divides. 0 where a row was not fitted."""
    record, used, noise = fit.train, fit.used, fit.noise_model
    residuals = np.where(used, fit.residuals, 0.0)
    x = residuals if signal is None else np.where(used, signal, 0.0)
    if noise is None:
        return x * record.weights / max(fit.noise.sigma, 1e-300)
    rows = rows_of(record, used, np.where(used, record.output + residuals, 0.0))
    return np.asarray(noise.whitened(jnp.asarray(x), rows))


def lags_of(correlation_time: float, train: Record, used: Bool[np.ndarray, " rows"]) -> int:
    """How many lags are looked at: three correlation times, 20 to 200, a quarter of the longest sequence at
    most."""
    longest = max(int(used[rows].sum()) for _, rows in train.sequences())
    return max(min(max(20, int(3 * correlation_time)), 200, longest // 4), 1)


def speed(record: Record) -> Float[np.ndarray, " rows"]:
    """The input's change since the row before, over time where there is a clock; where a sequence begins,
    that of the next row."""
    found = np.zeros(len(record))
    for _, rows in record.sequences():
        if rows.stop - rows.start > 1:
            step = np.diff(record.input[rows])
            if record.time is not None:
                step = step / np.diff(record.time[rows])
            found[rows] = np.append(step[:1], step)
    return found


def has_one_speed(v: Float[np.ndarray, " rows"]) -> bool:
    """Whether an input only ever moves at one rate, up and down."""
    size = np.abs(v)
    size = size[size > 1e-3 * size.max(initial=0.0)]
    low, high = np.quantile(size, [0.1, 0.9]) if len(size) else (0.0, 0.0)
    return bool(high < 1.5 * low) if len(size) else True


def _products(
    x: np.ndarray, y: np.ndarray, used: np.ndarray, starts: np.ndarray, lags: np.ndarray
) -> tuple[Float[np.ndarray, " lags"], Float[np.ndarray, " lags"]]:
    """Sums over the used rows of one sequence of x_i y_(i-k) for each lag k, and how many products each
    is."""
    sums, pairs = np.zeros(len(lags)), np.zeros(len(lags))
    for a, b in zip(starts, [*starts[1:], len(x)], strict=True):
        have = used[a:b].astype(float)
        size = 2 * max(b - a, 1)
        inside = np.abs(lags) < b - a
        for total, (one, other) in ((sums, (x[a:b], y[a:b])), (pairs, (have, have))):
            spectra = np.fft.rfft(one * have, size), np.fft.rfft(other * have, size)
            total[inside] += np.fft.irfft(spectra[0] * spectra[1].conj(), size)[lags[inside]]
    return sums, np.round(pairs)


def _cross(
    e: np.ndarray, x: np.ndarray, used: np.ndarray, starts: np.ndarray, lags: np.ndarray
) -> Correlation | None:
    size = np.sqrt(np.sum(e[used] ** 2) * np.sum(x[used] ** 2))
    if not size > 0:
        return None
    products, _ = _products(e, x, used, starts, lags)
    return Correlation(lags, products / size, *_bands(int(used.sum()), len(lags)))


def _bands(rows: int, lags: int) -> tuple[float, float]:
    """Half widths for one lag and for all: Sidak's, of Gaussian correlations."""
    tails = 1 - CHANCE / 2, 0.5 + 0.5 * (1 - CHANCE) ** (1 / lags)
    one, all_ = (float(scipy.special.ndtri(tail) / np.sqrt(max(rows, 1))) for tail in tails)
    return one, all_


def _whitened(
    signals: tuple[np.ndarray, ...], used: np.ndarray, starts: np.ndarray
) -> tuple[np.ndarray, ...]:
    """All signals through the autoregressive filter that makes the first one as white as it gets.

    Its order is chosen by the Bayesian information criterion, its coefficients are Yule and Walker's.
    """
    # As many as R's `ar` tries.
    most = int(10 * np.log10(used.sum()))
    products, pairs = _products(signals[0], signals[0], used, starts, np.arange(most + 1))
    best, least = np.ones(1), np.log(max(products[0], 1e-300))
    for order in range(1, most + 1 if products[0] > 0 else 1):
        a = -scipy.linalg.solve_toeplitz(products[:order], products[1 : order + 1])
        left = max(products[0] + a @ products[1 : order + 1], 1e-300)
        score = np.log(left) + order * np.log(pairs[0]) / pairs[0]
        if score < least:
            best, least = np.append(1.0, a), score
    pieces = [slice(int(a), int(b)) for a, b in zip(starts, [*starts[1:], len(used)], strict=True)]
    return tuple(
        np.concatenate([scipy.signal.lfilter(best, [1.0], x[rows]) for rows in pieces])
        for x in signals
    )


def _itself_in_words(itself: Correlation, p_value: float) -> str:
    lags = len(itself.lags)
    chance = f"p = {p_value:.2g}" if p_value >= 1e-6 else "p < 1e-6"
    if p_value > CHANCE:
        return f"The residuals are white: Ljung-Box {chance} over {lags} lags."
    worst = int(np.argmax(np.abs(itself.values)))
    return (
        f"The residuals are not white: Ljung-Box {chance} over {lags} lags; those"
        f" {_rows(int(itself.lags[worst]))} apart correlate by {itself.values[worst]:.2g}."
    )


def _input_in_words(found: Correlation) -> list[str]:
    if (worst := found.worst) is None:
        return []
    lag, value = worst
    if lag < 0:
        return [f"Residuals precede the input by {_rows(-lag)} ({value:.2g}): is a clock late?"]
    why = "its curve is off" if lag < 2 else "a memory of it is missing"
    return [f"Residuals follow the input{_at(lag)} (correlation {value:.2g}): {why}."]


def _speed_in_words(
    found: Correlation | None, train: Record, used: Bool[np.ndarray, " rows"]
) -> list[str]:
    if found is None or (worst := found.worst) is None:
        return []
    lag, value = worst
    if lag < 0:
        return [f"Residuals precede the input's speed by {_rows(-lag)} ({value:.2g})."]
    why = "rate dependence is missing or wrong"
    if lag > 1:
        why = "a part that relaxes is missing or wrong"
    elif train.time is None or has_one_speed(speed(train)[used]):
        # Where there is one speed, its sign is the branch.
        why = "the loop's width is off, or rate dependence is missing"
    return [f"Residuals follow the input's speed{_at(lag)} (correlation {value:.2g}): {why}."]


def _at(lag: int) -> str:
    return " at lag 0" if lag == 0 else f" {_rows(lag)} later"


def _rows(count: int) -> str:
    return f"{count} row{'s'[: count > 1]}"
