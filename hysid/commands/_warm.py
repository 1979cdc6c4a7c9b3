"""`hysid warm`: compile ahead what fits and their compensators run."""

import numpy as np

import identify
from compensate import invert
from compensate.guards._run_in import driven
from hysteresis import AbstractModel, InputError
from hysteresis.laws import KINDS
from hysteresis.running._compiled import available, loop_of
from hysteresis.running._law import law
from hysteresis.running._numbers import Structure
from hysteresis.running._over_time import compiled_at_once

from ._asked import Warm
from ._console import Done


def run(asked: Warm) -> Done:
    """Compile what these fits run, forwards and backwards; without any, each law alone.

    Raises `InputError` `missing-extra` without Numba, and what reading a fit raises.
    """
    if not available():
        raise InputError(
            "missing-extra",
            "nothing can be compiled: Numba cannot be imported.",
            fix='install it: python -m pip install "numba>=0.63"',
        )
    before = loop_of.cache_info().currsize
    with compiled_at_once():
        for folder in asked.fits or ():
            _run(identify.load(folder).model)
    if not asked.fits:
        for kind in KINDS:
            own = {} if kind == "series" else law(kind).functions
            for way, needed in (("run", "move"), ("find", "find")):
                if needed in own:
                    loop_of(Structure(kind, (), ()), way)
    loops = loop_of.cache_info().currsize - before
    return Done({"loops": loops}, [f"{loops} loops are compiled."])


def _run(model: AbstractModel) -> None:
    """Three samples within what the model was trained on, and their estimates."""
    low, high = (0.0, 1.0) if model.trained is None else map(float, model.trained)
    t, u = np.arange(3.0), driven(model, np.linspace(low, high, 3))
    y = np.asarray(model.simulate(t, u))
    try:
        compensator = invert(model)
    except InputError:
        return
    compensator.simulate(t, y if u.ndim == 1 else np.column_stack([y, u[:, 1]]))
