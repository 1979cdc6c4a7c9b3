"""What an estimate is worth."""

from enum import IntEnum


class Status(IntEnum):
    """What an estimate is worth."""

    OK = 0
    EXTRAPOLATED = 1
    """Beyond the inputs the model knows; continued along its memoryless part."""
    SATURATED = 2
    """Beyond the outputs the model can have; held at the end of its range."""
    FLAT = 3
    """The model does not change here: the nearest input is held."""
    BELOW_THRESHOLD = 4
    """No contact yet: any input below the threshold gives this output."""
    INVALID = 5
    """The sample was NaN or infinite: the last estimate is held, the state untouched."""
