"""A tree's loops, compiled: once for each structure, kept on disk from one process to the next.

Without numba the same text is run by Python, a hundred times as slowly.
"""

import hashlib
import importlib.util
import os
import re
import sys
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from importlib.metadata import version
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from .._files import forget_oldest, own_folder
from ._in_python import in_python
from ._law import MATHS, kept
from ._numbers import Structure
from ._text import text_of

MOST = 200_000_000
"""Bytes of compiled laws that are kept; one takes some hundred thousand."""

_ENTRY = re.compile(r"\w+_[0-9a-f]{24}\..*")
"""Names of our files, and of those that numba puts beside them."""

_HEADER = f"""\
from math import {", ".join(MATHS)}

from numba import njit as _njit, types

from hysteresis.running._memory import MARKS, get, put, whole

globals().update(MARKS)
njit = _njit(error_model="numpy")


def loop(made):
    kinds = types.void(*[types.int64] * made.__code__.co_argcount)
    return _njit(kinds, cache=CACHED, nogil=True, error_model="numpy")(made)


"""


@cache
def available() -> bool:
    """Whether numba is there, and knows this NumPy."""
    try:
        import numba as numba  # half a second
    except ImportError:
        return False
    return True


def is_kept(structure: Structure, wanted: str) -> bool:
    """Whether a loop has been compiled before, by this process or another one."""
    folder, name = _folder(), _name(structure, wanted)
    return name in sys.modules or bool(folder and (folder / f"{name}.py").exists())


@kept
def loop_of(structure: Structure, wanted: str) -> Callable[..., None]:
    """The loop `wanted` of a tree, as `_kernels.py` says; of arrays in place of addresses."""
    if not available():
        return in_python(structure, wanted)
    compiled = getattr(_module(structure, wanted), wanted)

    def call(*given: Any) -> None:
        # What is passed has to stay alive and in one piece until the loop is through.
        compiled(*(x.ctypes.data if isinstance(x, np.ndarray) else x for x in given))

    return call


@kept
def reals_of(structure: Structure) -> int:
    """Reals of a move that are not in m."""
    line = next(x for x in text_of(structure, "tangents").splitlines() if x.startswith("LOCALS = "))
    return int(line.removeprefix("LOCALS = "))


def table_of(D: np.ndarray, spots: np.ndarray) -> np.ndarray:
    """What marks are told of the table of tangents and of the parameters that are directions."""
    return np.array([D.ctypes.data, D.shape[1], spots.ctypes.data]) if available() else D


@cache
def _folder() -> Path | None:
    folder, _ = own_folder("laws")
    if folder is not None:
        with suppress(OSError):
            forget_oldest(folder, MOST, _ENTRY)
    return folder


@kept
def _name(structure: Structure, wanted: str) -> str:
    """Of the module: other texts, and those that another numba compiles, have other names."""
    memory = (Path(__file__).parent / "_memory.py").read_text("utf-8")
    whole = f"{_HEADER}{text_of(structure, wanted)}{memory}{version('numba')}{sys.version}"
    return f"{wanted}_{hashlib.sha256(whole.encode()).hexdigest()[:24]}"


def _module(structure: Structure, wanted: str) -> ModuleType:
    name, folder, text = _name(structure, wanted), _folder(), text_of(structure, wanted)
    if folder is not None:
        # What a full disk or another process has left half done is compiled again.
        with suppress(Exception):
            return _kept(name, folder / f"{name}.py", _HEADER.replace("CACHED", "True") + text)
    module = ModuleType(name)
    text = _HEADER.replace("CACHED", "False") + text
    exec(compile(text, f"<{name}>", "exec"), vars(module))
    return module


def _kept(name: str, path: Path, text: str) -> ModuleType:
    """A module from disk, beside which numba keeps what it has compiled."""
    if not path.exists() or path.read_text("utf-8") != text:
        half = path.with_suffix(f".{os.getpid()}")
        half.write_text(text, "utf-8")
        half.replace(path)
    specification = importlib.util.spec_from_file_location(name, path)
    assert specification is not None
    assert specification.loader is not None
    module = importlib.util.module_from_spec(specification)
    sys.modules[name] = module  # numba looks a kept function's module up
    try:
        specification.loader.exec_module(module)
    except BaseException:
        del sys.modules[name]
        raise
    return module
