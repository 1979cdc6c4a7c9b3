"""Other units or another sign, or a feedback: y = offset + factor * inner output."""


class Parameters:
    """Factor, not zero, and offset."""

    factor: float
    offset: float


class State:
    """No memory."""

    status: int


def onward(p: Parameters, y: float) -> float:
    return p.offset + p.factor * y


def back(p: Parameters, y: float) -> float:
    return (y - p.offset) / p.factor
