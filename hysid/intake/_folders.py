"""Folders of fits: their names, where those of several fits are, and whether they can be written."""

import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from hysteresis import InputError


def folders_of(folder: Path, document: Mapping[str, Any]) -> dict[str, str]:
    """The folder of every fit of a document by its value of `each`, `{"": "."}` of one alone.

    Raises `InputError` where one is not right below `folder`: nothing is read or written elsewhere.
    """
    folders = document.get("folders", {"": "."})
    names = list(folders.values()) if isinstance(folders, dict) else [folders]
    odd = [n for n in names if not isinstance(n, str) or n == ".." or {*n} & {"/", "\\", ":"}]
    if odd or not isinstance(folders, dict):
        raise InputError(
            "outside-folder",
            f"fit.json names the folder {(odd or names)[0]!r}, which is not inside this folder.",
            place=str(folder),
            cause="fit.json was edited.",
            fix="Fit again.",
        )
    return folders


def folder_names(values: Iterable[str]) -> dict[str, str]:
    """A folder for each value: letters, digits and .-_ stay, so that no value leads out of `out`."""
    names: dict[str, str] = {}
    for value in values:
        name = "".join(c if c.isalnum() or c in "-_." else "_" for c in value)
        if value and not name.strip("."):
            name = f"_{name}"
        while name.casefold() in map(str.casefold, names.values()):
            name += "_"
        names[value] = name or "."
    return names


def check_writable(out: Path) -> None:
    """Said before the fit rather than after it."""
    there = next(place for place in (out, *out.absolute().parents) if place.exists())
    if not there.is_dir() or not os.access(there, os.W_OK):
        why = "You have no permission to write there" if there.is_dir() else f"{there} is a file"
        raise InputError(
            "cannot-write", f"{why}.", place=str(out), fix="Name another folder (--out)."
        )
