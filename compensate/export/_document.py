"""The file of a document that `compensate.runtime` reads."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hysteresis import InputError
from hysteresis._atomic_file import write_whole

from ..runtime._compensator import _replay
from ..runtime._file import checksum


def write(path: str | Path, document: Mapping[str, Any]) -> Path:
    """Write a document with its checksum, as the runtime reads it, whole or not at all."""
    path = Path(path)
    write_whole(path, json.dumps({**document, "checksum": checksum(document)}) + "\n")
    return path


def require_one_input(document: dict[str, Any]) -> None:
    """Raise `InputError` `not-invertible` where plain Python finds other inputs than JAX in the golden
    pair: both search, and only where a reading has several inputs do they end at different ones."""
    _, off = _replay(document)
    if off > document["golden"]["tolerance"]:
        raise InputError(
            "not-invertible",
            f"plain Python finds an input {off:.3g} off that of JAX: the model's output falls while its"
            " input rises, so that a reading has several inputs.",
            fix="export another model.",
        )
