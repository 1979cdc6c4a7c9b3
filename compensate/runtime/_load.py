"""`load`: whatever runs reading by reading, by the kind that its file names."""

import json
from pathlib import Path

from ._compensator import Compensator
from ._compensator import load as load_compensator
from ._network import KIND as FORCE
from ._network import ForceEstimator, load_force


def load(path: str | Path) -> Compensator | ForceEstimator:
    """The compensator or force estimator of a file, once it has replayed the golden pair in it.

    Raises `FileError` where the file cannot be used: not one, of another format, changed, or replayed
    otherwise.

    **Example:**

        >>> file = compensate.export_runtime(model, folder / "sensor.json", model.simulate(t, u)).path
        >>> compensate.runtime.load(file).rates
        False
    """
    return load_force(path) if _kind(path) == FORCE else load_compensator(path)


def _kind(path: str | Path) -> str | None:
    """What the file says it is; None where it does not, which is said by who reads it whole."""
    try:
        document = json.loads(Path(path).read_bytes())
    except (OSError, ValueError, RecursionError, MemoryError):
        return None
    return document.get("kind") if isinstance(document, dict) else None
