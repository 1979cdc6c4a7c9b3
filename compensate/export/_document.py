"""The file of a document that `compensate.runtime` reads."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hysteresis._atomic_file import write_whole

from ..runtime._file import checksum


def write(path: str | Path, document: Mapping[str, Any]) -> Path:
    """Write a document with its checksum, as the runtime reads it, whole or not at all."""
    path = Path(path)
    write_whole(path, json.dumps({**document, "checksum": checksum(document)}) + "\n")
    return path
