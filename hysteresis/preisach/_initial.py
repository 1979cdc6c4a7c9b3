"""The relays before the first sample, as inputs that lead there from all down."""

from typing import Any

import numpy as np

from .._errors import InputError

Initial = str | tuple[float, ...]
"""One of `WORDS`, or inputs that lead from negative saturation to the state."""

WORDS = ("negative", "positive", "demagnetised")


def word_or_inputs(initial: Any) -> Initial:
    """As given, a sequence as a tuple of floats."""
    return initial if isinstance(initial, str) else tuple(float(u) for u in initial)


def check_initial(initial: Initial, low: float, high: float) -> None:
    """Raises `InputError` for an unknown word, or an input outside [low, high]."""
    if isinstance(initial, str):
        if initial not in WORDS:
            said = f"no initial state {initial!r}."
            mend = f"give one of {', '.join(WORDS)}, or a tuple of inputs."
            raise InputError("bad-option", said, fix=mend)
        return
    for u in initial:
        if not low <= u <= high:
            raise InputError(
                "out-of-range",
                f"an input that leads to the initial state is {u:g}, outside [{low:g}, {high:g}].",
                fix="clip it: beyond the bounds all relays are down, or all up.",
            )


def staircase(initial: Initial, low: float, high: float, turns: int) -> list[float]:
    """Inputs that bring the relays from negative saturation to the initial state."""
    if initial == "negative":
        return []
    if initial == "positive":
        return [high]
    if initial == "demagnetised":
        # An alternation that decays by the same step each time, as a laboratory demagnetises.
        amplitude = (high - low) / 2 * (1 - np.arange(turns) / turns)
        alternation = (low + high) / 2 + amplitude * (-1.0) ** np.arange(turns)
        # Half the sum and half the difference of two ends may round beyond them.
        return np.clip(alternation, low, high).tolist()
    return list(initial)  # type: ignore[arg-type]
