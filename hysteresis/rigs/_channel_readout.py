"""What turns the relative change of a soft channel into a reading: two electronics."""

from dataclasses import dataclass, fields

import numpy as np
from jaxtyping import Float, Int

from .._errors import InputError


@dataclass(frozen=True, kw_only=True)
class ResistiveReadout:
    """A current source through each channel, an amplifier, a passive low-pass, a converter.

        reading = gain I R_0 (R - R_0)/R_0 in V,    V_0 = I R_0 = 0.435 V

    The amplifier's reference takes V_0 away, so that a sensor at rest reads zero.

    **Arguments:** (the range's low end below its high end, noise 0 or more, all others above 0)

    - `resistance_ohm`, `current_a`: R_0 and I; the paper's source gives 0.070 to 0.080 A.
    - `gain`: of the amplifier, which the paper does not print.
    - `low_pass_s`: time constant of the low-pass.
    - `noise`: standard deviation of a reading in V, behind the low-pass.
    - `low`, `high`: V, the ends of the converter's range, after a divider: every section at 8 N
      together makes 17 V. `bits`: of the converter, 10 as in the paper's microcontroller.

    Source: Kim and Park (2018), section II.

    **Example:**

        >>> readout = hysteresis.rigs.ResistiveReadout()
        >>> readout.counts(np.array([0.0, 1.0, 50.0])).tolist()
        [25, 75, 1023]
    """

    resistance_ohm: float = 5.8
    current_a: float = 0.075
    gain: float = 20.0
    low_pass_s: float = 0.002
    noise: float = 0.02
    low: float = -0.5
    high: float = 20.0
    bits: int = 10

    def __post_init__(self) -> None:
        _check(self)

    @property
    def scale(self) -> float:
        """V of reading for a relative change of 1: the amplified V_0."""
        return self.gain * self.current_a * self.resistance_ohm

    def counts(self, reading: Float[np.ndarray, "*shape"]) -> Int[np.ndarray, "*shape"]:
        """Of the converter, 0 to 2^bits - 1, where it also stays beyond its range."""
        return _counts(reading, self.low, self.high, self.bits)


@dataclass(frozen=True, kw_only=True)
class CapacitiveReadout:
    """Channels that are capacitors in parallel, and a converter from capacitance to counts.

        reading = C - C_0 = C_0 (C - C_0)/C_0 in pF

    A dielectric that is pressed thinner by the part x changes its capacitance by x/(1 - x), the law by
    which a closing channel changes its resistance; only the electronics differ.

    **Arguments:** (the range's low end below its high end, noise 0 or more, all others above 0)

    - `rest_pf`: C_0. `low_pass_s`: time over which the converter averages, as a low-pass.
    - `noise`: standard deviation of a reading, pF. `low`, `high`: pF, the converter's range; `bits`.

    Source: the future work of Kim and Park (2018); no figures are printed for it. The noise is a fifth
    of the resistive one's 0.23 % of the signal at rest, for the higher resolution they hope for.

    **Example:**

        >>> readout = hysteresis.rigs.CapacitiveReadout()
        >>> readout.counts(np.array([0.0, 1.0, 50.0])).tolist()
        [1598, 3197, 65535]
    """

    rest_pf: float = 20.0
    low_pass_s: float = 0.002
    noise: float = 0.0092
    low: float = -1.0
    high: float = 40.0
    bits: int = 16

    def __post_init__(self) -> None:
        _check(self)

    @property
    def scale(self) -> float:
        """pF of reading for a relative change of 1."""
        return self.rest_pf

    def counts(self, reading: Float[np.ndarray, "*shape"]) -> Int[np.ndarray, "*shape"]:
        """Of the converter, 0 to 2^bits - 1, where it also stays beyond its range."""
        return _counts(reading, self.low, self.high, self.bits)


def _counts(reading: np.ndarray, low: float, high: float, bits: int) -> np.ndarray:
    last = 2**bits - 1
    return np.clip(np.rint((reading - low) / (high - low) * last), 0, last).astype(int)


def _check(readout: ResistiveReadout | CapacitiveReadout) -> None:
    wrong = [
        f"{field.name} = {value}"
        for field in fields(readout)
        if not np.isfinite(value := getattr(readout, field.name))
        or (field.name not in ("low", "high") and value < 0)
        or (field.name not in ("low", "high", "noise") and value == 0)
    ]
    if readout.low >= readout.high:
        wrong.append(f"low = {readout.low}, high = {readout.high}")
    if wrong:
        raise InputError(
            "bad-option", f"{wrong[0]} is out of range.", place=type(readout).__name__,
            fix="Give finite numbers above 0 (noise: 0 or more), low below high.",
        )  # fmt: skip
