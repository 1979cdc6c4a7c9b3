"""The moving Preisach model: the output adds to the input.

y = f[u + feedback y], f the inner model

Source: Della Torre 1966.
"""

from ._codes import SATURATED


class Parameters:
    """Feedback, and the inner model's outputs in saturation."""

    feedback: float
    floor: float
    ceiling: float


class State:
    """No memory of its own."""

    status: int


def less_feedback(p: Parameters, h: float, y: float, status: int) -> float:
    """The input, from what the inner model sees. What is out of reach does not come back to it either."""
    reached = y
    if status == SATURATED:
        if y < p.floor:
            reached = p.floor
        if y > p.ceiling:
            reached = p.ceiling
    return h - p.feedback * reached
