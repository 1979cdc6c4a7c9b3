"""`load`: whatever runs reading by reading, by the kind that its file names."""

import json
from pathlib import Path
from typing import Any

from ._armor import KIND as ARMOR
from ._armor import load_armor
from ._compensator import Compensator
from ._compensator import load as load_compensator
from ._contact_forces import KIND as CONTACTS
from ._contact_forces import load_contacts
from ._network import KIND as FORCE
from ._network import load_force


def load(path: str | Path) -> Compensator | Any:
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
    loads = {FORCE: load_force, CONTACTS: load_contacts, ARMOR: load_armor}
    return loads.get(_kind(path) or "", load_compensator)(path)


def _kind(path: str | Path) -> str | None:
    """What the file says it is; None where it does not, which is said by who reads it whole."""
    try:
        document = json.loads(Path(path).read_bytes())
    except (OSError, ValueError, RecursionError, MemoryError):
        return None
    kind = document.get("kind") if isinstance(document, dict) else None
    return kind if isinstance(kind, str) else None
