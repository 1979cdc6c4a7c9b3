"""The status of an estimate."""

from enum import IntEnum


class Status(IntEnum):
    """Whether an estimate can be used, and if not, why."""

    OK = 0
    EXTRAPOLATED = 1
    """The input is beyond those the model knows. The estimate continues along the memoryless part; a guard
    holds it at the nearer end of the trained inputs, or makes it NaN."""
    SATURATED = 2
    """The output is beyond those the model can have. The estimate is held at the end of its range."""
    FLAT = 3
    """The model does not change here, so several inputs fit. The nearest one is held."""
    BELOW_THRESHOLD = 4
    """There is no contact yet. Any input below the threshold gives this output."""
    INVALID = 5
    """The sample was NaN or infinite. The last estimate is held, and the state does not change."""
    RUN_IN = 6
    """The memory before the first sample is not known, and the readings so far have not replaced it yet.
    The estimate can be off by as much as the loop is wide."""
