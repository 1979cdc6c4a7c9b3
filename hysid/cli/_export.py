"""`hysid export`."""

from pathlib import Path
from typing import Annotated

import typer

from ._console import AsJson, Folder, log, one_of, print_result, start_jax, warnings


def export(
    folder: Folder,
    c: Annotated[
        Path | None, typer.Option("--c", metavar="FILE.h", help="Write a C99 header.")
    ] = None,
    runtime: Annotated[
        Path | None, typer.Option(metavar="FILE.json", help="Write a file for compensate.runtime.")
    ] = None,
    to: Annotated[
        tuple[str, Path] | None,
        typer.Option(
            metavar="TARGET OUT",
            help="Write OUT for a target: c, runtime, arduino, ros2, mujoco, sklearn, onnx, fmu, fmu3.",
        ),
    ] = None,
    single: Annotated[
        bool, typer.Option("--float", help="Use float instead of double in C.")
    ] = False,
    fixed: Annotated[
        bool,
        typer.Option(
            "--fixed", help="Use integers (fixed point): Preisach grids with --to arduino."
        ),
    ] = False,
    depth: Annotated[
        int, typer.Option(min=3, help="Number of reversals that a Preisach model stores.")
    ] = 64,
    limits: Annotated[
        tuple[float, float] | None,
        typer.Option(help="LOW HIGH: readings beyond these limits are clipped to them."),
    ] = None,
    beyond: Annotated[
        str,
        typer.Option(
            callback=one_of("limit", "nan", "free"),
            help="What becomes of estimates beyond the trained inputs: limit, nan or free. Their status is"
            " EXTRAPOLATED in any case.",
        ),
    ] = "limit",
    start: Annotated[
        str,
        typer.Option(
            callback=one_of("unknown", "known"),
            help="What is known of the memory before the first reading: unknown (RUN_IN until the readings"
            " have replaced it) or known (the model's virgin state).",
        ),
    ] = "unknown",
    date: Annotated[
        str,
        typer.Option(metavar="YYYY-MM-DD", help="Date of the data (default: of the fitted file)."),
    ] = "",
    as_json: AsJson = False,
) -> None:
    """Write a fit's compensator as C99, for plain Python, or for a target around the C99.

    None of them needs JAX.
    """
    targets = {"c": c, "runtime": runtime, **dict([to] if to else [])}
    targets = {target: path for target, path in targets.items() if path is not None}
    if not targets:
        raise typer.BadParameter(
            "nothing to write; give --c FILE.h, --runtime FILE.json or --to TARGET OUT"
        )
    if fixed and single:
        raise typer.BadParameter("give --float or --fixed, not both")
    start_jax()
    from ..operations import _export  # after JAX is set up

    real = "fixed" if fixed else "float" if single else None
    found = _export.export(
        folder, targets, real=real, limits=limits, depth=depth, beyond=beyond, start=start, date=date,
    )  # fmt: skip
    for line in warnings(found["notes"]):
        log(line)
    print_result(found, as_json, filter(None, [found["text"], *found["files"].values()]))
