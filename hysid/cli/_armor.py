"""`hysid armor`."""

from pathlib import Path
from typing import Annotated

import typer

from ._console import AsJson, Overwrite, example, print_result, start_jax, warnings

armor = typer.Typer(
    help="Contacts on a robot's armor: calibrate, solve, look at them.", no_args_is_help=True
)

SPONGE = typer.Option("--sponge", metavar="DIR", help="Fit of the cover, in either direction.")
SHAPE = typer.Option(
    "--shape", metavar="FILE", help="The shell: a TOML file, or a mesh (STL, OBJ, ...)."
)
ShapeUnit = Annotated[
    str | None,
    typer.Option(metavar="UNIT", help="Unit of the shape's lengths (default: the TOML's, else m)."),
]
Out = Annotated[Path, typer.Option("--out", help="Folder for the results.")]


@armor.command(
    epilog=example("hysid armor calibrate presses.csv --sponge sponge --shape box.toml --out armor")
)
def calibrate(
    file: Annotated[Path, typer.Argument(metavar="PRESSES.csv", help="Presses at known points.")],
    out: Out,
    sponge: Annotated[Path, SPONGE],
    shape: Annotated[Path, SHAPE],
    shape_unit: ShapeUnit = None,
    overwrite: Overwrite = False,
    as_json: AsJson = False,
) -> None:
    """Calibrate sensor, cover and frame with presses at known points.

    The table has columns Fx to Mz (what the sensor read), force (of the gauge), x, y, z (the touched point)
    and press; time and displacement where they were measured. The folder gets the calibrated armor, for
    `hysid armor solve --armor DIR`, and armor.json, which runs without JAX.
    """
    start_jax()
    from ..armor import _commands  # after JAX is set up

    found = _commands.calibrate(
        file, sponge, shape, out, unit=shape_unit, overwrite=overwrite
    )  # fmt: skip
    scatter = f"The cover differs by {1e3 * found['scatter']:.2g} mm from place to place."
    print_result(
        found, as_json, [*warnings(found["notes"]), found["table"], scatter, f"Armor: {out}"]
    )


@armor.command(
    epilog=example("hysid armor solve wrenches.csv --sponge sponge --shape box.toml --out touches")
)
def solve(
    file: Annotated[
        Path, typer.Argument(metavar="WRENCHES.csv", help="Columns Fx, Fy, Fz, Mx, My, Mz, time.")
    ],
    out: Out,
    sponge: Annotated[Path | None, SPONGE] = None,
    shape: Annotated[Path | None, SHAPE] = None,
    calibrated: Annotated[
        Path | None,
        typer.Option(
            "--armor", metavar="DIR", help="Calibrated armor, instead of --sponge and --shape."
        ),
    ] = None,
    shape_unit: ShapeUnit = None,
    stream: Annotated[
        bool,
        typer.Option("--stream", help="The rows are one stream: the cover has its history."),
    ] = False,
    dwell: Annotated[
        float | None,
        typer.Option(
            metavar="SECONDS", help="How long each load has rested, for a cover that creeps."
        ),
    ] = None,
    overwrite: Overwrite = False,
    as_json: AsJson = False,
) -> None:
    """Find the contacts behind wrenches: points, covariances and statuses.

    The folder gets contacts.csv, touches.json, which `hysid armor view` shows, and armor.json, which runs
    without JAX.
    """
    start_jax()
    from ..armor import _commands  # after JAX is set up
    from ..catalogue._synthetic import is_synthetic

    found = _commands.solve(
        file, out, sponge=sponge, shape=shape, calibrated=calibrated, unit=shape_unit,
        stream=stream, dwell=dwell, overwrite=overwrite, is_virtual=is_synthetic,
    )  # fmt: skip
    said = ", ".join(f"{count} {name}" for name, count in found["statuses"].items())
    lines = [*warnings(found["notes"]), f"{found['rows']} wrenches: {said}", found["file"]]
    print_result(found, as_json, lines)


@armor.command(epilog=example("hysid armor view tsuji2014"))
def view(
    folder: Annotated[
        Path,
        typer.Argument(
            metavar="DIR",
            help="Folder with touches.json, as hysid armor solve and hysid reproduce write it.",
        ),
    ],
    as_json: AsJson = False,
) -> None:
    """Write DIR/armor.html, a replay of the contacts in 3D."""
    start_jax()
    from ..armor import _view  # after JAX is set up

    found = _view.view(folder)
    print_result(found, as_json, [found["file"]])
