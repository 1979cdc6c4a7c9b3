"""A new record from arrays, for a model that was fitted to another one."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from hysteresis import ChannelMap, InputError, Record

from ._channel_map import combined_name


def new_record(
    fitted: Record,
    channels: ChannelMap | None,
    input: ArrayLike,
    time: ArrayLike | None,
    condition: ArrayLike | Mapping[str, ArrayLike] | None,
) -> Record:
    """One sequence of inputs (n,), or (n, channels), in the units of the fitted record; without outputs.

    Raises `InputError` `length-mismatch`, `bad-option`, and as `Record.from_arrays` does.
    """
    names, values = [*fitted.conditions], np.asarray(input, float)
    given = condition if isinstance(condition, Mapping) else dict.fromkeys(names[:1], condition)
    columns = {
        name: np.broadcast_to(np.asarray(x, float), len(values))
        for name, x in given.items()
        if x is not None
    }
    if (condition is not None and not names) or not {*columns} <= {*names}:
        raise InputError(
            "bad-option",
            f"The output depends on {', '.join(names) or 'no condition'} in this fit.",
            fix="Name its conditions alone (condition=)." if names else "Leave out condition=.",
        )
    wanted = (len(values),) if channels is None else (len(values), len(channels.names))
    if values.shape != wanted:
        raise InputError("length-mismatch", f"input: shape {values.shape}; the fit takes {wanted}.")
    if channels is not None:
        columns |= dict(zip(channels.names, values.T, strict=True))
        values = np.asarray(channels(values))
    return Record.from_arrays(
        values,
        np.full(len(values), np.nan),
        time,
        mask=np.zeros(len(values), bool),
        columns=columns,
        conditions={name: fitted.conditions[name] for name in columns if name in names},
        input_name=fitted.input_name if channels is None else combined_name(channels),
        input_unit=fitted.input_unit,
        output_name=fitted.output_name,
        output_unit=fitted.output_unit,
        time_unit=fitted.time_unit,
    )
