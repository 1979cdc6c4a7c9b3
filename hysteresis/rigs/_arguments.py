"""What every rig says of an argument that it cannot take."""

from .._errors import InputError


def fault(rig: str, problem: str, fix: str) -> InputError:
    """The error to raise, with the rig's name as its place."""
    return InputError("bad-option", problem, place=rig, fix=fix)


def require(rig: str, holds: bool, problem: str, fix: str) -> None:
    """Raises it where something does not hold."""
    if not holds:
        raise fault(rig, problem, fix)
