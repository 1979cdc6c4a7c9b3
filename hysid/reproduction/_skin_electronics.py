"""The electronics of a virtual skin: volts to counts and back, and what each part costs in force."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from compensate.microchannel import Readout
from hysteresis.rigs import CapacitiveReadout, ChannelRecord, ResistiveReadout


def readout_of(
    electronics: ResistiveReadout, channels: int, current: float | None = None
) -> Readout:
    """The `Readout` that knows these electronics; `current`, A: the one it takes for theirs."""
    return Readout(
        channels,
        resistance=electronics.resistance_ohm,
        current=electronics.current_a if current is None else current,
        gain=electronics.gain,
        low=electronics.low,
        high=electronics.high,
        bits=electronics.bits,
    )


def converted(
    volts: Float[np.ndarray, "samples channels"],
    electronics: ResistiveReadout | CapacitiveReadout,
    current: float | None = None,
) -> Float[np.ndarray, "samples channels"]:
    """What is left of volts after the converter and the way back through `Readout`.

    The changes of resistance that it tells are multiplied by the V_0 of the usual electronics, so that a
    network sees the same numbers whatever the current is. Where the current is another than the `Readout`
    takes it for, all changes are off by its factor.
    """
    assert isinstance(electronics, ResistiveReadout)  # as all sensors of the paper have
    back = readout_of(electronics, volts.shape[1], current)
    changes = back.simulate(np.arange(float(len(volts))), electronics.counts(volts)).value
    return ResistiveReadout().scale * np.asarray(changes)


def converted_record(
    record: ChannelRecord,
    electronics: ResistiveReadout | CapacitiveReadout,
    current: float | None = None,
) -> ChannelRecord:
    """The same of a record."""
    return record._replace(reading=converted(record.reading, electronics, current))


def variants() -> dict[str, tuple[ResistiveReadout, float | None]]:
    """Electronics, and the current in A that `Readout` takes for theirs."""
    usual = ResistiveReadout()
    quiet, coarse, fine = (replace(usual, **c) for c in ({"noise": 0.0}, {"bits": 8}, {"bits": 14}))
    whole = replace(usual, noise=0.0, bits=24, low_pass_s=1e-6)
    return {
        "as built: 75 mA, 2 ms, 20 mV of noise, 10 bits": (usual, None),
        "70 mA, known": (replace(usual, current_a=0.070), None),
        "80 mA, known": (replace(usual, current_a=0.080), None),
        "70 mA, taken for 75 mA": (replace(usual, current_a=0.070), usual.current_a),
        "80 mA, taken for 75 mA": (replace(usual, current_a=0.080), usual.current_a),
        "no noise of the amplifier": (quiet, None),
        "low-pass of 20 ms": (replace(usual, low_pass_s=0.02), None),
        "8 bits": (coarse, None),
        "14 bits": (fine, None),
        "no electronics: no noise, no low-pass, 24 bits": (whole, None),
    }
