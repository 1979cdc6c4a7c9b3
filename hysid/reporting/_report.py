"""`hysid.report`: the page about a fit in memory."""

from pathlib import Path
from tempfile import TemporaryDirectory

import identify
from hysteresis._atomic_file import telling, write_figure
from hysteresis._precision import in_own_precision
from identify import save_posterior
from identify.results._data_sheet import DataSheet

from ..figures import _base as f
from ..figures._data_sheet import PANELS, draw_panel, draw_sheet, subtitle, title
from ..figures._format import measured
from ._case import TARGET, Section, Table
from ._fit_page import render, write_report

FIRST = (
    "sensitivity", "non-linearity, best line", "hysteresis", "repeatability", "creep", "zero return",
)  # fmt: skip
"""Lines that stand large on the page."""


@in_own_precision
def write_data_sheet(sheet: DataSheet, path: str | Path) -> Path:
    """Write a data sheet: an HTML file that needs no other, or one page of PDF, by the file's name.

    **Arguments:**

    - `sheet`: what `data_sheet` returned.
    - `path`: the file, which is overwritten; .pdf, .png or .svg is the printed page, anything else HTML.

    **Returns:** the path of the file.

    **Raises:** `InputError` `cannot-write` where the file cannot be written.

    **Example:**

        >>> sheet = identify.data_sheet(record)
        >>> hysid.write_data_sheet(sheet, folder / "sensor.html").name
        'sensor.html'
    """
    path = Path(path)
    if path.suffix.lower() in (".pdf", ".png", ".svg"):
        with telling(path):
            f.styled(write_figure)(draw_sheet(sheet), path, dpi=150)
        return path
    pictures, lines = Section("Pictures"), Section("Lines")
    for draw, caption in PANELS:
        pictures.draw(draw_panel(sheet, draw), caption, caption)
    rows = [
        (row.name, measured(row), row.basis or row.reason, row.definition) for row in sheet.rows
    ]
    lines.tables.append(Table("", ("line", "value", "from", "definition"), rows))
    first = [sheet[name] for name in FIRST]
    return render(
        path,
        title=title(sheet),
        subtitle=subtitle(sheet),
        level="",
        headline="In short",
        answers=[(row.name, measured(row), row.basis or row.reason) for row in first],
        answers_note="± is the standard error that the noise of the readings leaves.",
        sections=[lines, pictures],
    )


@in_own_precision
def report(
    fit: identify.FitResult,
    path: str | Path = TARGET,
    posterior: identify.internal.Posterior | None = None,
) -> Path:
    """Write the report of a fit, and of its posterior, as one HTML file that needs no other.

    **Arguments:**

    - `fit`: what `fit` or `fit_step` returned.
    - `path`: the file, which is overwritten.
    - `posterior`: what `sample` returned for this fit.

    **Returns:** the path of the file.

    **Raises:** `InputError` `cannot-write` where the file cannot be written.

    **Example:**

        >>> hysid.report(fit, folder / "fit.html").name
        'fit.html'
    """
    with TemporaryDirectory() as folder:
        identify.save(fit, folder, overwrite=True)
        if posterior is not None:
            save_posterior(posterior, folder)
        return write_report(folder, Path(path))
