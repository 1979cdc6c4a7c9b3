"""Report section on the channel map, which combines several channels into one input."""

import numpy as np

from ..figures import _base as f
from ..figures._format import label, number, plain_name, quantity
from ._case import Case, Section, Table


def channels(case: Case) -> Section:
    combined, unit = case.fit.channels, case.units[1]
    assert combined is not None
    nodes, values = np.asarray(combined.nodes), np.asarray(combined.values)
    names = [plain_name(*of) for of in zip(combined.names, combined.units, strict=True)]
    axes = [label(*of) for of in zip(names, combined.units, strict=True)]
    what = (
        f"the {case.output} would be without memory"
        if combined.memory is None
        else "the channels tell with a memory, stops and slow states, of their own"
    )
    section = Section("Channels", [
        f"The input is a sum of curves, one for each of {len(names)} channels, in the unit of the"
        f" {case.output}: what {what}. Beyond its ends a curve keeps its end value. Falling curves next to"
        f" rising ones cancel effects that the channels measure and the {case.output} does not contain."
    ])  # fmt: skip
    figure = f.panels(axes, nodes, values, label("part of the input", unit))
    also = "" if combined.memory is None else " but its memory"
    caption = f"Contribution of each channel over its fitted range; a flat curve contributes nothing{also}."
    section.draw(figure, f"Curves of {len(names)} channels", caption)
    share = np.ptp(values, axis=1)
    rows = [
        (names[c], quantity(float(nodes[c, 0]), combined.units[c]),
         quantity(float(nodes[c, -1]), combined.units[c]), quantity(float(share[c]), unit),
         number(float(np.corrcoef(nodes[c], values[c])[0, 1])) if share[c] > 0 else "none")
        for c in np.argsort(-share)
    ]  # fmt: skip
    columns = ("Channel", "From", "To", "Range of its curve", "Sense")
    said = "Sense is the correlation of curve and channel: 1 rises throughout, −1 falls."
    section.tables.append(Table(said, columns, [tuple(row) for row in rows]))
    return section
