"""The work of one worker: one fit, in this process or another one."""

from collections.abc import Callable
from typing import Any, NamedTuple
from uuid import uuid4

import jax
import jax.numpy as jnp
import numpy as np

from hysteresis import InputError, Record
from hysteresis._note import ProgressNote
from hysteresis._serialisation import described

from ..fitting._candidates import candidates
from ..fitting._fit import INTERRUPTED, fit
from ..results._fit_result import FitResult
from ._folder import files_of

HOME = uuid4().hex
"""Tells this process from others: what was fitted here need not travel."""


class Fault(NamedTuple):
    """An `InputError` in the form in which it is sent between processes."""

    code: str
    problem: str
    words: dict[str, str]


def fit_alone(
    home: str,
    function: Callable[..., FitResult],
    options: dict[str, Any],
    train: Record,
    test: Record | None,
    double: bool,
) -> FitResult | dict[str, bytes] | Fault:
    """Fit one record; in another process, return the files of the fit."""
    try:
        with jax.enable_x64(double):
            if home != HOME and function is fit:
                for one in candidates(options["model"]):
                    described(one.template)  # raises where the files of its fit could not be loaded
            watched = {"progress": _interrupts} if function is fit else {}
            found = function(train, test=test, **watched, **unpacked(options))
            return found if home == HOME else files_of(found)
    except InputError as error:
        words = {"place": error.place, "cause": error.cause, "fix": error.fix}
        return Fault(error.code, error.problem, words)


def _interrupts(line: str) -> None:
    """Ctrl-C ends the batch: a fit that it cut short is not one of its results."""
    if isinstance(line, ProgressNote) and line.code == INTERRUPTED:
        raise KeyboardInterrupt


def packed(tree: Any) -> Any:
    """Convert JAX arrays to NumPy arrays: without x64 a process would unpickle them in single precision."""
    return jax.tree.map(lambda x: np.asarray(x) if isinstance(x, jax.Array) else x, tree)


def unpacked(tree: Any) -> Any:
    return jax.tree.map(lambda x: jnp.asarray(x) if isinstance(x, np.ndarray) else x, tree)
