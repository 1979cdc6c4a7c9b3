"""JSON documents, written whole and read with an error that says what is wrong."""

import json
import platform
from collections.abc import Iterable
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from hysteresis import InputError
from hysteresis._atomic_file import atomic_file
from hysteresis._escape import json_text
from hysteresis._format import plain
from hysteresis._limits import parse_json

# Which versions of which software made a result.


FIT = ("hysid", "jax", "equinox", "optimistix", "emcee", "numpy")
"""Packages that a fit depends on."""


def versions(packages: Iterable[str] = FIT) -> dict[str, str]:
    """The versions of Python and of `packages`; "not installed" for one that is missing."""
    return {"python": platform.python_version()} | {name: _version(name) for name in packages}


@cache
def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"


def write_json(file: Path, document: dict[str, Any]) -> None:
    """Write a JSON document, whole or not at all."""
    text = json_text(json.dumps(plain(document), indent=2, ensure_ascii=False)) + "\n"
    with atomic_file(file) as new:
        new.write_text(text, "utf-8")


def read_json(file: Path) -> dict[str, Any]:
    """A JSON object from a file.

    Raises `InputError` `damaged-file` if it cannot be read, or is not a JSON object.
    """
    try:
        document = parse_json(file.read_bytes())
    except (ValueError, OSError) as error:
        document = error
    if not isinstance(document, dict):
        raise InputError(
            "damaged-file",
            f"{file.name} cannot be read: {document}.",
            place=str(file.parent),
            cause="it was cut off, or is not ours.",
            fix="make it again.",
        )
    return document


def check_free(folder: str | Path, overwrite: bool, name: str = "fit.json") -> None:
    """Raise `InputError` if `folder` holds the results `name` and these may not be overwritten."""
    folder = Path(folder)
    if folder.exists() and not folder.is_dir():
        raise InputError("not-a-folder", f"{folder} is a file.", fix="name another folder (--out).")
    if (folder / name).exists() and not overwrite:
        raise InputError(
            "would-overwrite",
            "results are there already, and were left as they are.",
            place=str(folder),
            fix="name another folder (--out DIR), or write over them (--overwrite).",
        )
