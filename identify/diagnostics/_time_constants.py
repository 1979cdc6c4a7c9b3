"""Time constants that a record cannot show: longer than it lasts, shorter than its sampling steps."""

import numpy as np

from hysteresis import AbstractModel, Note, Record
from hysteresis._note import warning
from hysteresis.models._viscoelastic import AbstractViscoelastic


def unseen_time_constants(model: AbstractModel, record: Record) -> list[Note]:
    """A note for every branch whose time constant lies outside the times that the record shows.

    The shortest is the step of the clock that follows a change of the input, the median over all changes: a
    hold whose rows come ever more seldom shows what is over in its first second.

    An element that creeps flows like a dashpot for much less than its time constant, and gives way
    like a spring after much more; one that relaxes the other way round. Of the two parameters of such
    a branch the record knows one.
    """
    if not isinstance(model, AbstractViscoelastic) or record.time is None:
        return []
    sequences = [(record.time[rows], record.input[rows]) for _, rows in record.sequences()]
    span = max(float(np.ptp(t)) for t, _ in sequences)
    # Before its first row a model is at rest.
    changes = np.concatenate([np.abs(np.diff(u, prepend=0.0))[:-1] for _, u in sequences])
    steps = np.concatenate([np.diff(t) for t, _ in sequences])
    order = np.argsort(steps)
    passed = np.cumsum(changes[order])
    step = float(steps[order][np.searchsorted(passed, passed[-1] / 2)])
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
