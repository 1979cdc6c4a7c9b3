"""How many of the held-out rows lie beyond what a fit has seen, and how large its error is there."""

from typing import Any, NamedTuple


class RowsBeyond(NamedTuple):
    """Some held-out rows: how many, and the rms error over them; None where there are none."""

    rows: int
    rmse: float | None


class Extrapolation(NamedTuple):
    """Held-out rows beyond the range of the fitted ones, by what is beyond, and those inside all ranges.

    - `input`: the input, a channel of it or a condition lies outside the trained ones, see
      `FitResult.beyond`. `rate`: it moves faster than ever.
    - `time`: it has been held for longer than ever, where that means within 2 % of its range.
    - `inside`: none of these.
    """

    input: RowsBeyond
    rate: RowsBeyond
    time: RowsBeyond
    inside: RowsBeyond

    @property
    def document(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return {name: part._asdict() for name, part in self._asdict().items()}
