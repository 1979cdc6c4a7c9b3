"""`hysid datasets` on the command line: what it is told, what it prints."""

import shlex
from pathlib import Path
from typing import Annotated

import typer

from ..catalogue._catalogue import NOT_STATED, SHIPPED, catalogue, find, listing

datasets = typer.Typer(
    help="Measured data by third parties, to try models on.", no_args_is_help=True
)

Catalogue = Annotated[
    Path,
    typer.Option(
        "--catalogue",
        metavar="FILE",
        show_default=False,
        help="Another catalogue, such as your laboratory's own.",
    ),
]
AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object.")]


@datasets.command("list")
def list_(file: Catalogue = SHIPPED, as_json: AsJson = False) -> None:
    """Name, size, licence and kind of every data set."""
    from ._app import _print

    found = catalogue(file)
    lines = [f"{'name':25}{'size':>9}  {'licence':14}what"]
    lines += [
        f"{d.name:25}{d.bytes / 1e6:6.2f} MB  {d.licence or NOT_STATED:14}{d.what}"
        f"{'' if d.checked else ' *'}"
        for d in found
    ]
    if not all(d.checked for d in found):
        lines.append("* not all checksums are known: hysid datasets fetch NAME --accept")
    _print({"datasets": listing(found)}, as_json, lines)


@datasets.command()
def fetch(
    name: Annotated[str, typer.Argument(metavar="NAME", help="As hysid datasets list has it.")],
    out: Annotated[Path, typer.Option(help="Folder for NAME.csv and NAME.toml.")] = Path("."),
    accept: Annotated[
        bool, typer.Option("--accept", help="Take files whose checksum is not known.")
    ] = False,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Write over files that are there.")
    ] = False,
    file: Catalogue = SHIPPED,
    as_json: AsJson = False,
) -> None:
    """Fetch a data set, check it, and write it as a CSV with a TOML for hysid fit."""
    from ..catalogue._fetch import fetch as fetched
    from ._app import _print, _say

    dataset = find(name, file)
    found = fetched(dataset, out, accept=accept, overwrite=overwrite, say=_say)
    if not dataset.licence:
        _say("Mind: the source states no licence. Ask its owners before you pass anything on.")
    for note in found["notes"]:
        _say(f"Mind: {note}")
    table, config, fit = (shlex.quote(str(p)) for p in (found["file"], found["config"], out / name))
    lines = [f"{found['rows']} rows: {found['file']}", f"Please cite: {found['citation']}"]
    lines.append(f"Next: hysid fit {table} --config {config} --out {fit}")
    _print(found, as_json, lines)
