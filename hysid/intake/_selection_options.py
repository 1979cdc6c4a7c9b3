"""The selecting options: each field is a command-line option, a key of a configuration file, and a keyword.

A new option is one field here. No import of this module loads JAX: `hysid --help` reads the fields.
"""

import re
from dataclasses import Field, dataclass, fields
from functools import partial
from typing import Any

from ._fit_options import option

ASIDE = re.compile(r"\s*\((?=[^()]*--[a-z])[^()]*\)")
"""Brackets of a message that name options, with the blanks before them."""


_words = partial(option, default=(), joined=True)
_column = partial(option, default=None, metavar="COL")
_unit = partial(option, default=None, metavar="UNIT")


@dataclass(frozen=True)
class SelectionOptions:
    """Which rows and columns of a file are used, and which rows are held out for testing."""

    input: str | tuple[str, ...] | None = option(
        "Input column: its exact header. Repeat it for a sensor with several channels.",
        repeated=True,
        metavar="COL",
    )
    output: str = option("Output column: its exact header.", metavar="COL")
    time: str | None = _column("Time column.")
    dt: float | None = option(
        "Time between samples in seconds, where there is no time column.", None, metavar="SECONDS"
    )
    input_time: str | None = _column(
        "Time column of the input, where it has a clock of its own; --time is the output's."
    )
    step: float | None = option(
        "Fit creep or relaxation under this constant input, instead of --input.",
        None,
        metavar="VALUE",
    )
    frequency: str | None = _column(
        "Frequency column: fit a spectrum to moduli over frequency, --output being the storage modulus,"
        " instead of --input."
    )
    loss: str | None = _column("Column of the loss modulus, or of tan delta, beside --frequency.")
    hold: bool = option(
        "Fit creep or relaxation over the longest stretch in which --input is constant.", False
    )
    group: tuple[str, ...] = _words(
        "Rows with different values are independent sequences of one model.", metavar="COL[,COL]"
    )
    condition: tuple[str, ...] = _words(
        "The output depends on this column too: a temperature, a pressure, ...", metavar="COL[,COL]"
    )
    turn: tuple[str, ...] = _words(
        "Turn the sign of these columns: a push that the rig counts as a pull.", metavar="COL[,COL]"
    )
    rezero: tuple[str, ...] = _words(
        "Take jumps of the output's zero out: subtract SIZE from the output, from this line of the file to"
        " the end of its sequence. check finds line and size.",
        metavar="LINE:SIZE[,LINE:SIZE]",
    )
    known: str | None = option(
        "The output of the first N rows of every sequence, or of as many as this column says, is known"
        " beforehand: they tell the state in which the rest begins, and do not count.",
        None,
        metavar="N|COL",
    )
    sigma: str | None = _column(
        "Column of the output's standard deviation: fit, noise, errors and verdict weigh each row by its"
        " inverse square. Only ratios from row to row count."
    )
    each: str | None = _column("Fit one model for each value of this column.")
    where: tuple[str, ...] = option(
        "Use only these rows; repeatable.", (), repeated=True, metavar="COL=VALUE[,VALUE]"
    )
    branch: str | None = option(
        "Count only rows in which the input rises (loading) or falls (unloading), or each branch for itself"
        " (both). A sample where it turns belongs to both. All other rows are history.",
        None,
        choices=("loading", "unloading", "both"),
    )
    range: tuple[float, ...] = _words(
        "Count only rows with the input in this range; the others are history.", metavar="LOW,HIGH"
    )
    test_where: tuple[str, ...] = option(
        "Hold out these rows for testing; COL%2=0 holds out even values; repeatable.",
        (),
        repeated=True,
        metavar="COL=VALUE[,VALUE]",
    )
    test_cycles: int | None = option(
        "Hold out the last N cycles of each sequence for testing.", None, least=1, metavar="N"
    )
    test_tail: float | None = option(
        "Hold out this last fraction of each sequence for testing.", None, metavar="FRACTION"
    )
    test_lines: tuple[str, ...] = _words(
        "Hold out the rows on these lines of the file for testing.",
        metavar="FIRST-LAST[,FIRST-LAST]",
    )
    exclude_lines: tuple[str, ...] = _words(
        "Leave the rows on these lines of the file out of the fit; they still drive the model.",
        metavar="FIRST-LAST[,FIRST-LAST]",
    )
    nan: str = option(
        "Missing values: raise an error, omit (rows without output do not count, rows without both are left"
        " out), or interpolate.",
        "raise",
        choices=("raise", "omit", "interpolate"),
    )
    segments: str | None = option(
        "auto: a new sequence begins where the time goes back.", None, choices=("auto",)
    )
    decimal: str = option("Decimal sign of the file: . or ,", ".", choices=(".", ","))
    units_row: int | None = option(
        "Number of the line that holds the units; 0 for none.", None, least=0, metavar="N"
    )
    na_values: tuple[str, ...] = _words("Words that mean a missing value.", metavar="WORD[,WORD]")
    table: int | None = option(
        "Which of the file's tables with different headers; the longest if not given.",
        None,
        least=1,
        metavar="N",
    )
    dialects: str | None = option(
        "TOML file of further layouts of rig files.", None, metavar="FILE"
    )
    input_unit: str | None = _unit(
        "Unit of the input or of --step, where the header does not give it."
    )
    output_unit: str | None = _unit("Unit of the output, where the header does not give it.")


FIELDS: dict[str, Field[Any]] = {one.name: one for one in fields(SelectionOptions)}
"""By name, in the order in which help and configuration files list them."""

OF_READING = ("decimal", "units_row", "na_values", "table", "dialects")
"""The options that say how a file is read, before any column is chosen."""

HELD_OUT = tuple(name for name in FIELDS if name.startswith("test_"))
"""The options that hold out rows: a command that only looks at a file has none of them."""
