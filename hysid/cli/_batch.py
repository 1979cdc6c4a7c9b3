"""`hysid batch`."""

from pathlib import Path
from typing import Annotated

import typer

from ._config_file import SELECTION, Context, options_of
from ._console import AsJson, Out, log, print_result, start_jax
from ._selection import as_fields


def batch(
    context: Context,
    pattern: Annotated[str, typer.Argument(metavar="'GLOB'", help="Files, as in 'data/*.csv'.")],
    config: Annotated[
        Path,
        typer.Option(
            help="TOML file with the options of hysid fit: [selection], [fit], [parameters]."
        ),
    ],
    out: Out,
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="Dask scheduler that runs the fits.")
    ] = None,
    jobs: Annotated[int, typer.Option(min=1, help="Processes on this machine.")] = 1,
    resume: Annotated[
        bool, typer.Option("--resume/--no-resume", help="Skip files that are fitted already.")
    ] = True,
    as_json: AsJson = False,
) -> None:
    """Fit every file that matches a pattern.

    Each fit gets its own folder in --out. A file that cannot be fitted is named; the others go on.
    """
    root = context.find_root().command
    options = options_of(config, root.commands["fit"])  # type: ignore[attr-defined]
    selection = as_fields({name: options.pop(name) for name in SELECTION})
    start_jax(double=not options["allow_float32"])
    from ..intake._selection import Selection  # after JAX is set up
    from ..operations import _batch

    try:
        document = _batch.batch(
            pattern, Selection(**selection), out, scheduler=scheduler, jobs=jobs, resume=resume,
            say=log, **options,
        )  # fmt: skip
    except KeyboardInterrupt:
        if (table := out / "batch.csv").is_file():
            log(f"Fits so far: {table}. The same command with --resume fits the other files.")
        raise
    before = f" ({document['skipped']} of them by an earlier run)" if document["skipped"] else ""
    lines = [f"{document['fitted']} fitted{before}, {len(document['failed'])} failed."]
    lines += [f"{name}: {why}" for name, why in document["failed"].items()]
    print_result(document, as_json, [*lines, f"Table: {document['file']}"])
