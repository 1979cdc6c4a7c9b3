"""A play in front of what it is followed by: inputs that move by less than its width are held.

held = min(max(held before, u - width), u + width), which is what follows takes

Source: Krasnosel'skii and Pokrovskii 1989, for the play.
"""


class Parameters:
    """Half the width of the play."""

    width: float


class State:
    """Where the play is; the first input is where it begins."""

    status: int
    begun: int
    held: float


def look(p: Parameters, s: State, u: float) -> float:
    if not s.begun:
        return u
    if s.held < u - p.width:
        return u - p.width
    return u + p.width if s.held > u + p.width else s.held


def move(p: Parameters, s: State, u: float) -> float:
    s.held = look(p, s, u)
    s.begun = 1
    return s.held
