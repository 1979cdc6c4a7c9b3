"""`load`: whatever runs reading by reading, by the kind that its file names."""

import json
from pathlib import Path
from typing import Any

from . import _armor, _contact_forces, _network
from ._compensator import load as load_compensator
from ._file import replayed

LOADED = {
    _network.KIND: ("readings give forces {:.3g} off", _network.replay),
    _contact_forces.KIND: ("readings give forces {:.3g} off", _contact_forces.replay),
    _armor.KIND: ("contacts lie {:.3g} m off", _armor.replay),
}
"""What is wrong where a replay gives something else, and what replays a file of this kind."""


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
    kind = _kind(path) or ""
    return replayed(path, kind, *LOADED[kind]) if kind in LOADED else load_compensator(path)


def _kind(path: str | Path) -> str | None:
    """What the file says it is; None where it does not, which is said by who reads it whole."""
    try:
        document = json.loads(Path(path).read_bytes())
    except (OSError, ValueError, RecursionError, MemoryError):
        return None
    kind = document.get("kind") if isinstance(document, dict) else None
    return kind if isinstance(kind, str) else None
