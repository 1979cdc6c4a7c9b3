"""The laws: one step of each model as plain numbers, a file each, which runs as it is and becomes C.

Every file has two structures, `Parameters` and `State`, which tell the equation and the memory, and up to
four functions of them:

    look(p, s, dt, u)    the output at the input u, dt after the last sample; the state stays
    move(p, s, dt, u)    the same, and the state moves there
    follow(p, s, dt, u)  the state moves there; only where this costs less
    find(p, s, dt, y)    the input behind the output y; the state moves there; s.status is its worth

Those that need no time take no dt. Only what C has too is used: numbers, arrays of fixed length,
arithmetic, `math`, if, while, for over a range. `compensate.export._python_to_c99` translates it word by
word, comments included. A law that names no source is ours. One of another distribution is announced.
"""

from collections.abc import Callable
from importlib import import_module
from types import ModuleType

KINDS = (
    "adaptive", "bouc_wen", "chain", "clip", "curve", "curves_of_plays", "dead_band",
    "degrading_bouc_wen", "drift", "duhem", "feedback", "foam", "friction", "line",
    "maxwell", "occupancy", "oscillator", "plays", "polynomial", "preisach", "rate_form", "scaled",
    "series", "share", "softening", "stops", "stops_and_powers", "sum", "time_drift",
)  # fmt: skip
"""Of nodes of a tree."""

_ANNOUNCED: dict[str, ModuleType] = {}

FORGET: list[Callable[[], None]] = []
"""What empties each store of things made of laws: one that is announced again may have been edited."""


def announce(law: ModuleType) -> str:
    """Make the law of another distribution known; its kind is the last part of its module's name.

    A node of this kind in a tree, or in a file, then runs it. `hysteresis.register(law=...)` calls this; on
    a robot, where there is no JAX, call it before the file is loaded.

    Raises `ValueError` for a kind that another law has, and for a module that lacks a structure or a
    function.

    **Example:**

        >>> from hysteresis import laws
        >>> laws.announce(spring)
        'spring'
    """
    kind = law.__name__.rpartition(".")[2]
    missing = [x for x in ("Parameters", "State", "look", "move") if not hasattr(law, x)]
    if missing:
        raise ValueError(f"{law.__name__} is no law: it has no {missing[0]}")
    if kind in KINDS or _ANNOUNCED.get(kind, law).__name__ != law.__name__:
        raise ValueError(f"another law is called {kind!r}: rename {law.__name__}")
    _ANNOUNCED[kind] = law
    for forget in FORGET:
        forget()
    return kind


def withdraw(kind: str) -> None:
    """Announced it is no more."""
    _ANNOUNCED.pop(kind, None)


def announced() -> tuple[str, ...]:
    """Kinds of the laws of other distributions."""
    return tuple(_ANNOUNCED)


def module_of(kind: str) -> ModuleType:
    """The file of a law."""
    return _ANNOUNCED.get(kind) or import_module(f".{kind}", __package__)
