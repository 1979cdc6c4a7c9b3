"""Fits of several values, each in a folder of its own, which replace earlier ones all at once."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..storage._file_set import replace_sets
from ._fit_folder import OF_EARLIER


def replace_fits(
    folder: Path, document: dict[str, Any], staged: Mapping[str, Mapping[str, Any]]
) -> dict[str, Any]:
    """Write fit.json of several fits, which `write_fit` staged in folders below: all change at once."""
    return replace_sets(folder, "fit.json", document, staged, OF_EARLIER)
