"""Two clocks in one file: input and output were read at different times, noted beside each."""

from collections.abc import Mapping

import numpy as np

from .._errors import InputError
from .._note import Note


def on_one_clock(
    inputs: Mapping[str, np.ndarray],
    own: np.ndarray,
    time: np.ndarray,
    groups: np.ndarray | None,
    own_name: str,
    name: str,
) -> tuple[dict[str, np.ndarray], Note]:
    """Inputs (n,), read at the times `own` (n,), at the output's `time` (n,) instead; and a note.

    Linear within each group and each run of rising times; before the first and after the last reading the
    nearest one holds. A reading that is missing is left out.

    Raises `InputError` `time-backwards` where one clock goes back and the other does not, since nothing
    says which readings belong together.
    """
    label = (
        np.zeros(len(time), int) if groups is None else np.unique(groups, return_inverse=True)[1]
    )
    moved = {key: np.full(len(time), np.nan) for key in inputs}
    for value in np.unique(label):
        rows = np.flatnonzero(label == value)
        cut, other = (np.flatnonzero(np.diff(clock[rows]) < 0) + 1 for clock in (time, own))
        if not np.array_equal(cut, other):
            raise InputError(
                "time-backwards",
                f"The clocks {own_name!r} and {name!r} go back at different rows.",
                cause="several runs in one file, or a clock that stumbles.",
                fix="name the runs (--group COL), or use one clock (leave --input-time out).",
            )
        for part in np.split(rows, cut):
            for key, x in inputs.items():
                good = part[np.isfinite(x[part]) & np.isfinite(own[part])]
                if good.size:
                    moved[key][part] = np.interp(time[part], own[good], x[good])
    apart = float(np.nanmedian(np.abs(time - own)))
    said = (
        f"Input taken from its clock {own_name!r} to the output's {name!r} by linear interpolation:"
        f" they are {apart:.3g} apart in the median."
    )
    return moved, Note("one-clock", said)
