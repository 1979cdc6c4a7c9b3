"""`hysid datasets`."""

from pathlib import Path
from typing import Annotated

import typer

from ..catalogue._catalogue import NOT_STATED, SHIPPED, catalogue, find, listing
from ..commands._console import AsJson, example, log, print_result, warnings

datasets = typer.Typer(
    help="Data sets by third parties: list and download them.", no_args_is_help=True
)

Catalogue = Annotated[
    Path,
    typer.Option(
        "--catalogue",
        metavar="FILE",
        show_default=False,
        help="Another catalogue, for example the one of your laboratory.",
    ),
]


@datasets.command("list", epilog=example("hysid datasets list"))
def list_(file: Catalogue = SHIPPED, as_json: AsJson = False) -> None:
    """List every data set with its size, licence and kind."""
    found = catalogue(file)
    lines = [f"{'name':25}{'size':>9}  {'licence':14}what"]
    lines += [
        f"{d.name:25}{d.bytes / 1e6:6.2f} MB  {d.licence or NOT_STATED:14}{d.what}"
        f"{'' if d.checked else ' *'}"
        for d in found
    ]
    if not all(d.checked for d in found):
        lines.append("* Not all checksums are known. To fetch: hysid datasets fetch NAME --accept")
    print_result({"datasets": listing(found)}, as_json, lines)


@datasets.command(epilog=example("hysid datasets fetch steel-coupon --out steel"))
def fetch(
    name: Annotated[
        str, typer.Argument(metavar="NAME", help="Name, as hysid datasets list prints it.")
    ],
    out: Annotated[Path, typer.Option(help="Folder for NAME.csv and NAME.toml.")] = Path("."),
    accept: Annotated[
        bool, typer.Option("--accept", help="Accept files whose checksum is not known.")
    ] = False,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Overwrite existing files.")
    ] = False,
    file: Catalogue = SHIPPED,
    as_json: AsJson = False,
) -> None:
    """Download a data set and check it.

    hysid writes a CSV file and a configuration for hysid fit.
    """
    from ..catalogue import _fetch  # late: it loads NumPy

    dataset = find(name, file)
    found = _fetch.fetch(dataset, out, accept=accept, overwrite=overwrite, say=log)
    if not dataset.licence:
        log("Warning: The source states no licence. Ask its owners before you share the data.")
    for line in warnings(found["notes"]):
        log(line)
    from hysteresis._escape import shell_word  # late: it loads JAX

    table, config, fit = (shell_word(str(p)) for p in (found["file"], found["config"], out / name))
    lines = [f"{found['rows']} rows: {found['file']}", f"Please cite: {found['citation']}"]
    lines.append(f"Next: hysid fit {table} --config {config} --out {fit}")
    print_result(found, as_json, lines)
