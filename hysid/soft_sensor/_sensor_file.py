"""A soft sensor in a folder: JSON and plain arrays, nothing that can run.

soft_sensor.json   channels, names, settings       soft_sensor.npz   all arrays
"""

from pathlib import Path

from hysteresis._limits import damage_told, load_arrays
from hysteresis._serialisation import Arrays, described, rebuilt
from identify.internal import read_checked, whole_files, write_set

from ._sensor import Quantity, SoftSensor

SCHEMA = 1
KIND = "hysid soft sensor"
WORDS, ARRAYS = "soft_sensor.json", "soft_sensor.npz"
AGAIN = "train again (--overwrite)."
MAKE = "train a sensor: hysid microchannel train FILE --input COL --force COL --out DIR."

PARTS = ("readout", "force", "localizer", "position")


def save_sensor(sensor: SoftSensor, folder: str | Path) -> Path:
    """Write a sensor to a folder, which is made; one that is there is written over.

    Raises `InputError` for a part that cannot be kept in a file.
    """
    folder = Path(folder)
    arrays: Arrays = {}
    parts = {name: described(getattr(sensor, name), name, arrays)[0] for name in PARTS}
    document = {
        "schema": SCHEMA, "kind": KIND,
        "channels": [channel._asdict() for channel in sensor.channels], "step": sensor.step,
        "time_unit": sensor.time_unit,
        "force_in": sensor.force_in._asdict(),
        "position_in": [coordinate._asdict() for coordinate in sensor.position_in],
        **parts,
    }  # fmt: skip
    write_set(folder, WORDS, document, {ARRAYS: arrays})
    return folder


def load_sensor(folder: str | Path) -> SoftSensor:
    """Load a trained soft sensor from the folder that `hysid microchannel train` wrote.

    Nothing in the folder is executed.

    **Arguments:** `folder`: with soft_sensor.json and soft_sensor.npz.

    **Returns:** a `SoftSensor`: its channels, and an estimator for each quantity it was trained for.

    **Raises:** `InputError` where the folder has no sensor, a file is damaged or was changed, or a newer
    version of hysid wrote it.

    **Example:**

        >>> sensor = hysid.load_sensor(sensor_folder)
        >>> [channel.name for channel in sensor.channels]
        ['layer 1', 'layer 2']
    """
    folder = Path(folder)
    document = read_checked(folder, WORDS, SCHEMA, make=MAKE, again=AGAIN)
    with damage_told(WORDS, folder, AGAIN):
        if document["kind"] != KIND:
            raise ValueError("it holds something else")
        arrays = load_arrays(whole_files(folder, document, AGAIN)[ARRAYS])
        return SoftSensor(
            tuple(Quantity(**words) for words in document["channels"]),
            step=float(document["step"]), time_unit=document["time_unit"],
            force_in=Quantity(**document["force_in"]),
            position_in=tuple(Quantity(**words) for words in document["position_in"]),
            **{name: rebuilt(document[name], arrays) for name in PARTS},
        )  # fmt: skip
