"""`hysid check` and `hysid init`: what a file holds, before any fit."""

from pathlib import Path
from typing import Annotated, Any

import typer

from ..intake._selection_options import FIELDS, HELD_OUT
from ._config_file import Config
from ._console import AsJson, File, Overwrite, print_result, start_jax, warnings
from ._selection import takes_selection, values_of


@takes_selection(*(name for name in FIELDS if name not in HELD_OUT))
def check(
    file: File, selection: dict[str, Any], config: Config = None, as_json: AsJson = False
) -> None:
    """Describe a record and what makes a model hard to identify.

    Without columns, and without --config, the options are those of FILE's .toml.
    """
    start_jax()
    from ..intake._selection import Selection  # after JAX is set up
    from ..operations import _check

    found = _check.check(file, Selection(**selection))
    each, lines = selection["each"], []
    for value, one in found.get("each", {"": found}).items():
        lines += [f"{each} = {value}"] if value else []
        lines += [one.pop("text"), *warnings(one["warnings"])]
    failed = found.get("failed", {}).items()
    print_result(
        found, as_json, [*lines, *(f"{each} = {v} cannot be used: {e}" for v, e in failed)]
    )


@takes_selection(optional=True)
def init(
    file: File,
    selection: dict[str, Any],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", metavar="FILE.toml", help="Configuration to write (default: FILE's .toml)."
        ),
    ] = None,
    overwrite: Overwrite = False,
    as_json: AsJson = False,
) -> None:
    """Guess columns, units and cycles of a file; write its .toml.

    Give the columns that you know as options; hysid guesses the others, and what to hold out.
    """
    start_jax()
    from ..operations import _init  # after JAX is set up

    given = selection | {"input": list(values_of(selection.get("input")))}
    found = _init.init(file, out, given, overwrite=overwrite)
    lines = found.pop("lines")
    print_result(found, as_json, lines)
