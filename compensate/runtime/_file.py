"""A compensator's file: what it is checked for before it is used."""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

SCHEMA = 1


class FileError(ValueError):
    """A file that is not used: the message says where, why, and what to do."""


def checksum(document: Mapping[str, Any]) -> str:
    """SHA-256 of all but the checksum itself."""
    rest = {key: value for key, value in document.items() if key != "checksum"}
    text = json.dumps(rest, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()


def read(path: str | Path) -> dict[str, Any]:
    """The document of a file. Raises `FileError` where it is not one, newer, cut off or changed."""
    try:
        document = json.loads(Path(path).read_bytes())
    except OSError as error:
        raise FileError(f"{path}: {error.strerror}.") from None
    except ValueError:
        raise FileError(f"{path}: not whole, or no JSON. Export it again.") from None
    if not isinstance(document, dict) or document.get("kind") != "hysid compensator":
        raise FileError(
            f"{path}: not a compensator. Write one with hysid export DIR --runtime FILE."
        )
    if document.get("schema") != SCHEMA:
        raise FileError(
            f"{path}: written in format {document.get('schema')}, this version reads {SCHEMA}."
            " Update hysid, or export it again."
        )
    if document.get("checksum") != checksum(document):
        raise FileError(f"{path}: changed since it was written (checksum). Export it again.")
    return document
