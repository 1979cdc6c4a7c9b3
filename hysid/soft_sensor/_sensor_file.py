"""A soft sensor in a folder: JSON and plain arrays, nothing that can run.

soft_sensor.json   channels, names, settings       soft_sensor.npz   all arrays
"""

from pathlib import Path
from typing import Any

from compensate.runtime._file import checksum
from hysteresis import InputError
from hysteresis._limits import damage_told, load_arrays, parse_json
from hysteresis._serialisation import Arrays, described, rebuilt
from identify.internal import check_unedited, plain, whole_files, write_set

from ._sensor import Quantity, SoftSensor

SCHEMA = 1
KIND = "hysid soft sensor"
WORDS, ARRAYS = "soft_sensor.json", "soft_sensor.npz"
AGAIN = "Train again (--overwrite)."

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
    document = _document(folder)
    with damage_told(ARRAYS, folder, AGAIN):
        files = {"files": {ARRAYS: document["files"][ARRAYS]}}
        arrays = load_arrays(whole_files(folder, files, AGAIN)[ARRAYS])
    with damage_told(WORDS, folder, AGAIN):
        return SoftSensor(
            tuple(Quantity(**words) for words in document["channels"]),
            step=float(document["step"]), time_unit=document["time_unit"],
            force_in=Quantity(**document["force_in"]),
            position_in=tuple(Quantity(**words) for words in document["position_in"]),
            **{name: rebuilt(document[name], arrays) for name in PARTS},
        )  # fmt: skip


def _document(folder: Path) -> dict[str, Any]:
    file = folder / WORDS
    if not file.is_file():
        raise no_sensor(folder, WORDS)
    with damage_told(WORDS, folder, AGAIN):
        document = parse_json(file.read_bytes())
        if not isinstance(document, dict) or document.get("kind") != KIND:
            raise ValueError("it holds something else")
        if document.get("schema") != SCHEMA:
            raise InputError(
                "newer-schema",
                f"{WORDS} has schema {document.get('schema')}, but this version reads {SCHEMA}.",
                place=str(folder), fix="Update hysid, or train again.",
            )  # fmt: skip
        # Earlier versions wrote one checksum of the whole.
        if "checksum" in document or "checksums" not in document:
            said = document.get("checksum")
            if said != checksum(plain(document)):
                raise ValueError("its checksum does not agree")
    check_unedited(folder, WORDS, document)
    return document


def no_sensor(folder: Path, name: str) -> InputError:
    """What to say where the file `name` of a sensor is not there."""
    return InputError(
        "file-not-found", f"This folder has no {name}.", place=str(folder),
        fix="Train a sensor: hysid microchannel train FILE --input COL --force COL --out DIR.",
    )  # fmt: skip
