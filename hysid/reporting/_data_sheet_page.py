"""A data sheet as a file: one page to print."""

from pathlib import Path

from hysteresis import InputError
from hysteresis._atomic_file import telling, write_figure
from hysteresis._precision import in_own_precision
from identify.results._data_sheet import DataSheet

from ..figures._base import styled
from ..figures._data_sheet import draw_sheet


@in_own_precision
def write_data_sheet(sheet: DataSheet, path: str | Path) -> Path:
    """Write a data sheet: one page, each line with its error and its definition.

    **Arguments:**

    - `sheet`: what `data_sheet` returned.
    - `path`: the file, which is overwritten: .pdf, .png or .svg.

    **Returns:** the path of the file.

    **Raises:** `InputError` `bad-option` for another kind of file, `cannot-write`.

    **Example:**

        >>> sheet = identify.data_sheet(record)
        >>> hysid.write_data_sheet(sheet, folder / "sensor.pdf").name
        'sensor.pdf'
    """
    path = Path(path)
    if path.suffix.lower() not in (".pdf", ".png", ".svg"):
        raise InputError(
            "bad-option",
            f"A data sheet is no {path.suffix or 'file without a suffix'}.",
            place=str(path),
            fix="Name a .pdf, .png or .svg.",
        )
    with telling(path):
        styled(write_figure)(draw_sheet(sheet), path, dpi=150)
    return path
