"""Fitted models from reading to force, or from force to reading and run backwards."""

from dataclasses import replace

import numpy as np

import identify
from compensate import invert
from compensate.microchannel import BackwardsModel
from hysteresis import AbstractModel, InputError, Record

from ._force_networks import Found, Settings, predicted
from ._force_records import ForceData


def fit_structured(data: ForceData, part: np.ndarray, settings: Settings) -> Found:
    """The better of two fits on the part held out, of which neither has seen it."""
    data.check_one_channel("a structured estimator", "`hysid.fit` of several inputs")
    held = part == part.max()
    learnt = data.known & (part >= 0) & ~held
    tried: dict[str, tuple[float, AbstractModel, np.ndarray]] = {}
    faults = []
    for k, way in enumerate(("reading -> force", "force -> reading, run backwards")):
        settings.tell(k, 2, way)
        try:
            model, words = _fitted(data, learnt, settings.seed, backwards=k == 1)
        except InputError as error:
            faults.append(str(error))
            continue
        estimate = predicted(model, data)
        off = (estimate - data.force)[held & data.known]
        # A model that cannot be trusted to stay finite is none.
        if np.isfinite(off).all():
            tried[f"{way}: {words}"] = float(np.mean(off**2)), model, estimate
    if not tried:
        raise InputError("nothing-fits", " ".join(faults))
    settings.tell(2, 2, "fitted")
    best = min(tried, key=lambda way: tried[way][0])
    held_out = np.where(held, tried[best][2], np.nan)
    return Found(tried[best][1], held_out, (), {"model": best})


def _fitted(
    data: ForceData, learnt: np.ndarray, seed: int, *, backwards: bool
) -> tuple[AbstractModel, str]:
    """The model as the readings come: a lag between clocks would need those of later."""
    labels = tuple(map(str, range(len(data.starts))))
    rows = np.arange(len(data.time))
    record = Record(
        data.reading, data.force, data.time, np.array(data.starts), labels, learnt, rows
    )
    if not backwards:
        found = identify.fit(record, clocks="keep", seed=seed)
        return found.model, found.name
    force = np.interp(data.time, data.time[data.known], data.force[data.known])
    record = replace(record, input=force, output=data.reading)
    found = identify.fit(record, clocks="keep", seed=seed)
    return BackwardsModel(invert(found.model)), found.name
