"""Why a compensator that learns asks for a calibration."""

from enum import IntEnum


class Advice(IntEnum):
    """Why a calibration is needed now."""

    NONE = 0
    ZERO = 1
    """Something changed and is being learnt: most of it is the zero."""
    GAIN = 2
    """Most of it is the rise of the output."""
    LOOP = 3
    """Most of it is the width of the loop."""
    SHAPE = 4
    """Errors are large, and neither zero, gain nor width explains them: measure and fit again."""
    STALE = 5
    """The zero may have drifted too far since the last reference: give one."""
