"""What a contact is worth."""

from enum import IntEnum


class ContactStatus(IntEnum):
    """What a contact is worth. Only the first is to be used without a thought."""

    OK = 0
    NO_CONTACT = 1
    """No force to speak of, less than a tenth of the threshold: there is no line of action."""
    BELOW_THRESHOLD = 2
    """No surface is pushed with the threshold's force."""
    PULLING = 3
    """The force leaves through a surface: nothing that only touches can pull."""
    MISSED = 4
    """The line of action passes by every surface that the force could push."""
    AMBIGUOUS = 5
    """The line enters several surfaces apart; the likeliest is given, `candidates` lists all."""
    INVALID = 6
    """A channel was NaN or infinite."""
    SATURATED = 7
    """A channel of the sensor stood at the end of its range: the point is off by an unknown amount."""
    SECOND_SUPPORT = 8
    """More spin torque than the contact can transmit: something else bears on the shell."""
    EXTRAPOLATED = 9
    """The force is beyond those of the cover's fit, or the cover is pressed in further than it is thick."""
