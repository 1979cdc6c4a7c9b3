"""Time constants that a record cannot show: longer than it lasts, shorter than its sampling steps."""

import numpy as np

from hysteresis import AbstractModel, AbstractViscoelastic, Note, Record
from hysteresis._note import warning

SHOWN = 3
"""Steps no longer than a time constant that show it: one has its ends, the others show how it decays."""


def unseen_time_constants(model: AbstractModel, record: Record) -> list[Note]:
    """A note for every branch whose time constant lies outside the record's span of times.

    An element that creeps flows like a dashpot for much less than its time constant, and gives way
    like a spring after much more; one that relaxes the other way round. Of the two parameters of such
    a branch the record knows one.
    """
    if not isinstance(model, AbstractViscoelastic) or record.time is None:
        return []
    spans = [float(np.ptp(record.time[rows])) for _, rows in record.sequences()]
    steps = np.concatenate([np.diff(record.time[rows]) for _, rows in record.sequences()])
    # Where rows lie closer after a step of the input, they show what the usual distance would not.
    span, step = max(spans), float(np.sort(steps)[min(SHOWN, len(steps)) - 1])
    found, unit = [], record.time_unit
    with np.errstate(divide="ignore"):
        constants = 1 / np.asarray(model.chain().rates)
    for number, constant in enumerate(constants, start=1):
        if step <= constant <= span:
            continue
        slow = constant > span
        than = f"longer than the record ({span:.3g} {unit})"
        mend = "measure longer holds"
        if not slow:
            than = f"shorter than the sampling steps ({step:.3g} {unit})"
            mend = "sample faster"
        seen = "dashpot" if slow == model.creeps else "spring"
        said = f"Branch {number} has a time constant of {constant:.3g} {unit}, {than}: it is"
        said += f" identifiable only as a {seen}; {mend}, or fit a model without it."
        found.append(warning("unseen-time-constant", said))
    return found
