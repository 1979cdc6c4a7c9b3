"""`load`: whatever runs reading by reading, by the kind that its file names."""

from pathlib import Path
from typing import Any

from . import _armor, _compensator, _contact_forces, _network
from ._file import Replays, replayed

LOADED: Replays[Any] = {
    _compensator.KIND: ("readings give estimates {:.3g} off", _compensator.replay),
    _network.KIND: ("readings give forces {:.3g} off", _network.replay),
    _contact_forces.KIND: ("readings give forces {:.3g} off", _contact_forces.replay),
    _armor.KIND: ("contacts lie {:.3g} m off", _armor.replay),
}


def load(path: str | Path) -> Any:
    """The `Compensator`, `ForceEstimator`, `MultiContactEstimator` or `Armor` of a file, once it has
    replayed the golden pair in it.

    Each has `step(dt, reading) -> (value, status, deviation)`; that of an `Armor` gives an `ArmorContact`.

    Raises `FileError` where the file cannot be used: not one, of another format, changed, or replayed
    otherwise.

    **Example:**

        >>> file = compensate.export_runtime(model, folder / "sensor.json", model.simulate(t, u)).path
        >>> value, status, deviation = compensate.runtime.load(file).step(0.01, 0.0)
        >>> value, status.name
        (0.0, 'OK')
    """
    return replayed(path, LOADED)
