"""What turns the relative change of a soft channel into a reading."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from ._arguments import check_fields, require


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
        check_fields(self, ("noise",), ("low", "high"))
        require(
            type(self).__name__,
            bool(np.isfinite([self.low, self.high]).all()) and self.low < self.high,
            f"low = {self.low}, high = {self.high}.",
            "Give finite numbers, low below high.",
        )

    @property
    def scale(self) -> float:
        """V of reading for a relative change of 1: the amplified V_0."""
        return self.gain * self.current_a * self.resistance_ohm

    def counts(self, reading: Float[np.ndarray, "*shape"]) -> Int[np.ndarray, "*shape"]:
        """Of the converter, 0 to 2^bits - 1, where it also stays beyond its range."""
        last = 2**self.bits - 1
        part = (reading - self.low) / (self.high - self.low)
        return np.clip(np.rint(part * last), 0, last).astype(int)
