"""The laws: one step of each model as plain numbers, a file each, which runs as it is and becomes C.

Every file has two structures, `Parameters` and `State`, which tell the equation and the memory, and up to
four functions of them:

    look(p, s, dt, u)    the output at the input u, dt after the last sample; the state stays
    move(p, s, dt, u)    the same, and the state moves there
    follow(p, s, dt, u)  the state moves there; only where this costs less
    find(p, s, dt, y)    the input behind the output y; the state moves there; s.status is its worth

Those that need no time take no dt. Only what C has too is used: numbers, arrays of fixed length,
arithmetic, `math`, if, while, for over a range. `compensate.export._python_to_c99` translates it word by
word, comments included. A law that names no source is ours.
"""

from importlib import import_module
from types import ModuleType


def module_of(kind: str) -> ModuleType:
    """The file of a law."""
    return import_module(f".{kind}", __package__)
