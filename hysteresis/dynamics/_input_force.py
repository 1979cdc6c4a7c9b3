"""The force behind a measured displacement: in a band of frequencies, with its noise."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from .._errors import InputError
from .._precision import in_own_precision
from ._oscillator import Oscillator
from ._rate_form import BoucWenForce, DuhemForce
from ._recorder import continued, interpolated

FINER = 8
"""Points between samples on which the hysteresis follows the displacement."""


class InputForce(NamedTuple):
    """A force estimated from a displacement.

    - `force`: (samples,). `sigma`: its standard deviation by the noise of the displacement, not counting
      that of the hysteretic force; NaN where that noise was not given.
    """

    force: Float[np.ndarray, " samples"]
    sigma: float


@in_own_precision
def input_force(
    model: Oscillator,
    t: ArrayLike,
    displacement: ArrayLike,
    *,
    band: float,
    sigma: float | None = None,
    periodic: bool = False,
) -> InputForce:
    """The force that moved an oscillator as measured, as far as it lies below the frequency `band`.

        u = m y'' + c y' + k y + z[y]

    y is limited to the band, where its derivatives are exact; z follows it. White noise of standard
    deviation sigma in y becomes sigma |k - m w^2 + i c w| in the force, which grows with the square of
    the frequency; its root mean square over the band is reported. The ends of a record without a period
    are less certain.

    **Arguments:**

    - `t`, `displacement`: (samples,) on an even clock. `band`: in cycles a unit of time.
    - `sigma`: standard deviation of the displacement's noise.
    - `periodic`: the record is one period in steady state.

    Raises `InputError` `uneven-clock`, or `bad-option` for a band beyond the Nyquist frequency.

    **Example:**

        >>> spring = hysteresis.BoucWenForce(alpha=5e4, beta_gamma=800.0, beta_delta=-1100.0)
        >>> plant = hysteresis.Oscillator(mass=2.0, damping=10.0, stiffness=5e4, hysteresis=spring)
        >>> t = np.arange(3000) / 750
        >>> u = 40 * np.sin(2 * np.pi * 30 * t) * np.sin(np.pi * t / 4) ** 2
        >>> found = hysteresis.input_force(plant, t, plant.displacement(t, u), band=120.0, sigma=1e-7)
        >>> bool(np.abs(found.force - u).max() < 0.01 * u.max())
        True
    """
    t, y = np.asarray(t, float), np.asarray(displacement, float)
    steps = np.diff(t)
    dt = float(steps.mean())
    if not np.allclose(steps, dt, rtol=1e-3, atol=0):
        raise InputError("uneven-clock", "the times are not even.", fix="resample the record.")
    if not 0 < band < 0.5 / dt:
        raise InputError(
            "bad-option", f"band={band}; above 0 and below {0.5 / dt:g}, half the sampling rate."
        )
    wide, before = (y, 0) if periodic else continued(y)
    count = len(wide)
    w = 2 * np.pi * np.fft.rfftfreq(count, dt)
    spectrum = np.where(w <= 2 * np.pi * band, np.fft.rfft(wide), 0)
    smooth = np.fft.irfft(spectrum, count)
    stiffness = -float(model.mass) * w**2 + 1j * float(model.damping) * w + float(model.stiffness)
    linear = np.fft.irfft(spectrum * stiffness, count)
    fine = interpolated(smooth, FINER, "band-limited", True)
    path = np.concatenate([fine, fine]) if periodic else fine[before * FINER :]
    z = np.zeros(len(path))
    clock = np.arange(len(path)) * dt / FINER
    for part in model.parts:
        # A force in rate form is 0 where the record begins; plays know where that is.
        begin = path[0] if isinstance(part, BoucWenForce | DuhemForce) else 0.0
        z += np.asarray(part.simulate(clock, path - begin))
    z = (z[-len(fine) :] if periodic else z)[::FINER]
    if not periodic:  # it comes back to where it began, so that the band can be cut out of it
        after = len(z) - len(y)
        z[len(y) :] = z[0] + (z[len(y) :] - z[0]) * 0.5 * (
            1 + np.cos(np.pi * np.arange(after) / after)
        )
        z = np.concatenate([np.full(before, z[0]), z])
    z = np.fft.irfft(np.where(w <= 2 * np.pi * band, np.fft.rfft(z), 0), count)
    found = (linear + z)[before : before + len(y)]
    inside = w <= 2 * np.pi * band
    share = np.sum(np.abs(stiffness[inside]) ** 2) * 2 / count
    noise = float("nan") if sigma is None else float(sigma * np.sqrt(share))
    return InputForce(found, noise)
