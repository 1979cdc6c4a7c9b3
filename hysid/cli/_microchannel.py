"""`hysid microchannel`."""

import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from ._console import (
    AsJson,
    Overwrite,
    Progress,
    Seed,
    example,
    log,
    one_of,
    print_result,
    start_jax,
    warnings,
)  # fmt: skip
from ._selection import takes_selection

microchannel = typer.Typer(
    help="Soft sensors: train one, estimate force and place.",
    no_args_is_help=True,
)


@microchannel.command(
    epilog=example(
        "hysid microchannel train run.csv --input 'layer 1 (V)' --force 'force (N)'"
        " --time 'time (s)' --test-tail 0.2 --out sensor"
    )
)
@takes_selection(
    "input", "time", "dt", "group", "where", "test_where", "test_cycles", "test_tail", "nan",
    "segments", "decimal", "units_row", "na_values", "input_unit", needs_input=True,
)  # fmt: skip
def train(
    files: Annotated[
        list[Path], typer.Argument(metavar="FILE...", help="CSV files; each is one session.")
    ],
    out: Annotated[Path, typer.Option("--out", help="Folder for the sensor.")],
    selection: dict[str, Any],
    force: Annotated[str | None, typer.Option(help="COL: force to learn.")] = None,
    place: Annotated[
        str | None,
        typer.Option(help="COL: name of the pressed place, empty where nothing is pressed."),
    ] = None,
    position: Annotated[
        list[str] | None,
        typer.Option(help="COL: one coordinate of the pressed point; repeat it for each."),
    ] = None,
    test_file: Annotated[
        list[Path] | None, typer.Option(help="Hold out this whole session for testing; repeatable.")
    ] = None,
    kind: Annotated[
        str,
        typer.Option(help="Force model: network, everett, structured, or auto (the best of them)."),
    ] = "auto",
    epochs: Annotated[
        int | None,
        typer.Option(min=1, help="Epochs per network (default: 20,000 steps of 64 rows)."),
    ] = None,
    members: Annotated[
        int,
        typer.Option(
            min=2, help="Number of networks; each is trained with a different part held out."
        ),
    ] = 5,
    places: Annotated[
        str, typer.Option(help="NAME[,NAME]: names of the places (default: those in the files).")
    ] = "",
    method: Annotated[
        str,
        typer.Option(
            callback=one_of("gaussian", "neighbours"),
            help="How places are told apart: gaussian (of log ratios), or neighbours, as the paper does.",
        ),
    ] = "gaussian",
    noise: Annotated[
        float | None,
        typer.Option(help="Standard deviation of a reading (default: estimated from the data)."),
    ] = None,
    range: Annotated[
        tuple[float, float] | None,
        typer.Option(help="LOW HIGH of the converter: readings there are SATURATED."),
    ] = None,
    force_unit: Annotated[
        str | None, typer.Option(help="Unit of the force, where the header does not give it.")
    ] = None,
    seed: Seed = 0,
    resume: Annotated[
        bool, typer.Option("--resume", help="Resume from the checkpoint in --out.")
    ] = False,
    overwrite: Overwrite = False,
    as_json: AsJson = False,
) -> None:
    """Train a soft sensor on CSV files; write it to a folder.

    The sensor learns to estimate force, place or position.
    """
    if range is not None and not range[0] < range[1]:
        raise typer.BadParameter("--range is LOW HIGH, with LOW below HIGH")
    start_jax()
    from ..intake._selection import Selection  # after JAX is set up
    from ..soft_sensor import _train

    settings = _train.Settings(
        kind, epochs, members, seed, noise, range, _words(places), resume, method
    )
    chosen = Selection(**selection, output=force or "", output_unit=force_unit)
    targets = _train.Targets(force, place, tuple(position or ()))
    try:
        with Progress("training") as progress:
            document = _train.train(
                files, chosen, targets, out, settings=settings, tests=test_file or (),
                overwrite=overwrite, say=log, progress=progress,
            )  # fmt: skip
    except KeyboardInterrupt:
        if (out / _train.CHECKPOINT).is_dir():
            from hysteresis._escape import shell_word  # JAX is loaded now

            given = [word for word in sys.argv[1:] if word not in ("--resume", "--overwrite")]
            log(f"To resume: hysid {' '.join(map(shell_word, [*given, '--resume']))}")
        raise
    print_result(document, as_json, _trained_lines(document, out))


@microchannel.command(
    "train-pairs",
    epilog=example(
        "hysid microchannel train-pairs run.csv --input 'layer 1 (V)' --input 'layer 2 (V)'"
        " --force 'force B (N)' --force 'force D (N)' --time 'time (s)' --group session --out pair"
    ),
)
@takes_selection(
    "input", "time", "dt", "group", "where", "test_where", "nan", "segments", "decimal", "units_row",
    "na_values", "input_unit", needs_input=True,
)  # fmt: skip
def train_pairs(
    files: Annotated[
        list[Path], typer.Argument(metavar="FILE...", help="CSV files; each is one session.")
    ],
    out: Annotated[Path, typer.Option("--out", help="Folder for the estimator.")],
    selection: dict[str, Any],
    force: Annotated[
        list[str], typer.Option(help="COL: the force on one place; repeat it for each.")
    ],
    epochs: Annotated[
        int | None,
        typer.Option(min=1, help="Epochs per network (default: 20,000 steps of 64 rows)."),
    ] = None,
    high: Annotated[
        float | None,
        typer.Option(help="Largest force to find, N (default: 1.1 of the largest in the files)."),
    ] = None,
    noise: Annotated[
        float, typer.Option(min=0, help="Least standard deviation of a reading.")
    ] = 0.0,
    seed: Seed = 0,
    overwrite: Overwrite = False,
    as_json: AsJson = False,
) -> None:
    """Train an estimator of the forces on several places at once; write it to a folder.

    Each place is learnt from the sequences that press it alone. Sequences that press several judge it.
    The folder also gets runtime.json, which runs without JAX.
    """
    start_jax()
    from ..intake._selection import Selection  # after JAX is set up
    from ..soft_sensor import _contacts_command

    chosen = Selection(**selection, output=force[0])
    with Progress("training") as progress:
        document = _contacts_command.train_pairs(
            files, chosen, force, out, noise=noise, high=high, epochs=epochs, seed=seed,
            overwrite=overwrite, say=log, progress=progress,
        )  # fmt: skip
    lines = [*warnings(document["notes"]), *_contact_lines(document["metrics"])]
    print_result(document, as_json, [*lines, f"Estimator: {out}"])


@microchannel.command(
    epilog=example("hysid microchannel estimate sensor new.csv"),
)
@takes_selection("where", "na_values")
def estimate(
    folder: Annotated[
        Path,
        typer.Argument(
            metavar="DIR", help="Folder of a trained sensor, of pairs, or of a fit of a force."
        ),
    ],
    file: Annotated[
        Path, typer.Argument(metavar="FILE", help="CSV file with the sensor's channels.")
    ],
    selection: dict[str, Any],
    out: Annotated[
        Path | None,
        typer.Option("--out", help="CSV file to write (default: DIR/estimated-FILE.csv)."),
    ] = None,
    runtime: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.json", help="Of a fit: write a file for compensate.runtime too."
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Run a trained sensor, or a fit between a force and a reading, over a file.

    If the file has the true values too, the errors are printed. A fit from force to reading is inverted;
    its forces have the deviation of the rows that it held out, and are limited to its range.
    """
    start_jax()
    from ..soft_sensor import _contacts_command, _estimate  # after JAX is set up

    if _contacts_command.is_contacts(folder):
        document = _contacts_command.estimate_contacts(folder, file, out, **selection)
    elif _estimate.is_plain_fit(folder):
        from ..soft_sensor import _estimate_fit  # likewise

        document = _estimate_fit.estimate_by_fit(folder, file, out, runtime, **selection)
    elif runtime is not None:
        raise typer.BadParameter("--runtime is for the folder of a fit; hysid export is for others")
    else:
        document = _estimate.estimate(folder, file, out, **selection)
    print_result(document, as_json, _estimated_lines(document))


def _words(text: str) -> tuple[str, ...]:
    return tuple(part.strip() for part in text.split(",") if part.strip())


def _trained_lines(document: dict[str, Any], out: Path) -> list[str]:
    lines = warnings(document["notes"])
    if (force := document["force"]) is not None:
        lines.append(
            f"Force: {force['kind']}; cross-validated on the training rows: {force['held_out_rmse']:.3g}"
            f" rms ({force['held_out_nrmse_percent']:.3g} % of the range)"
        )
    for part, said in (("train", "Training"), ("test", "Held-out")):
        if (figures := document["metrics"][part]) is not None:
            rows = document[f"rows_{part}"]
            lines += [f"{said} rows ({rows}):", *(f"  {x}" for x in _figure_lines(figures))]
    return [*lines, f"Sensor: {out}"]


def _contact_lines(found: dict[str, Any] | None) -> list[str]:
    """Errors of each place's force."""
    return [
        f"{name}: {of['rmse']:.3g} N rms, {of['nrmse_percent']:.3g} % of the range; 90 % bands hold"
        f" {100 * of['coverage_of_90_percent_bands']:.0f} % of the rows"
        for name, of in (found or {}).items()
    ]


def _figure_lines(figures: dict[str, Any]) -> list[str]:
    from ..soft_sensor._estimate import confusion_lines  # late: it loads JAX

    lines = []
    if (force := figures.get("force")) is not None:
        lines.append(f"force: {force['rmse']:.3g} rms, {force['nrmse_percent']:.3g} % of the range")
    if (place := figures.get("place")) is not None:
        lines.append(f"place: {place['accuracy']:.1%} of {place['rows']} rows correct")
        lines += [f"  {line}" for line in confusion_lines(place["confusion"])]
        if place["rows_at_rest"]:
            lines.append(
                f"  {place['rest_taken_for_a_place']} of {place['rows_at_rest']} rows without a place"
                " were assigned one"
            )
    if (position := figures.get("position")) is not None:
        lines.append(
            f"position: mean error {position['mean_error']:.3g},"
            f" 95 % within {position['q95_error']:.3g}"
        )
    return lines


def _estimated_lines(document: dict[str, Any]) -> list[str]:
    lines = warnings(document["notes"])
    for channel, faults in document["channels_at_fault"].items():
        said = ", ".join(f"{fault} in {n} rows" for fault, n in faults.items())
        lines += warnings([f"{channel}: {said}."])
    figures = {k: document[k] for k in ("place", "position") if k in document}
    lines += _contact_lines(document.get("contacts"))
    if document["rmse"] is not None:
        figures["force"] = document
    if not document.get("contacts"):
        lines += _figure_lines(figures) or ["The file has no measured values to compare with."]
    return [*lines, f"{document['flagged']} of {document['rows']} rows flagged", document["file"]]
