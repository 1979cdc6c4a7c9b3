"""The electronics of a virtual skin: volts to counts and back."""

import numpy as np
from jaxtyping import Float

from compensate.microchannel import Readout
from hysteresis.rigs import ChannelRecord, ResistiveReadout


def converted(
    volts: Float[np.ndarray, "samples channels"],
    electronics: ResistiveReadout,
    current: float | None = None,
) -> Float[np.ndarray, "samples channels"]:
    """What is left of volts after the converter and the way back through a `Readout` that knows them.

    `current`, A: what the `Readout` takes for theirs; all changes are off by the factor between the two.
    The changes of resistance are multiplied by the V_0 of the usual electronics, so that a network sees the
    same numbers whatever the current is.
    """
    back = Readout(
        volts.shape[1], resistance=electronics.resistance_ohm,
        current=electronics.current_a if current is None else current, gain=electronics.gain,
        low=electronics.low, high=electronics.high, bits=electronics.bits,
    )  # fmt: skip
    changes = back.simulate(np.arange(float(len(volts))), electronics.counts(volts)).value
    return ResistiveReadout().scale * np.asarray(changes)


def converted_record(
    record: ChannelRecord,
    electronics: ResistiveReadout,
    current: float | None = None,
) -> ChannelRecord:
    """The same of a record."""
    return record._replace(reading=converted(record.reading, electronics, current))
