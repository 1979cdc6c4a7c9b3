"""`hysid predict`, `hysid qualify` and `hysid monitor`: a fit on new data."""

from typing import Annotated, Any

import typer

from ..intake._selection_options import OF_READING
from ._console import USER, AsJson, File, Folder, Progress, print_result, start_jax, warnings
from ._selection import takes_selection


@takes_selection("where", "nan", "segments", *OF_READING, optional=True)
def predict(
    folder: Folder,
    file: File,
    selection: dict[str, Any],
    inverse: Annotated[
        bool,
        typer.Option("--inverse", help="Run the compensator: estimate the input from the output."),
    ] = False,
    steady: Annotated[
        bool,
        typer.Option(
            "--steady",
            help="Oscillator: the force has run so often that the motion repeats itself.",
        ),
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Run a fitted model, or its compensator, over a file.

    The file has the columns that the fit used. --where, --nan and how the file is read are by default those
    of the fit.
    """
    start_jax()
    from ..operations import _predict  # after JAX is set up

    found = _predict.predict(folder, file, inverse=inverse, steady=steady, changes=selection)
    compared = "The file has no measured values to compare with"
    if found["rmse"] is not None:
        compared = f"{found['rmse']:.4g} rms, {found['nrmse_percent']:.3g} % of the range"
    lines = [f"{compared}; {found['flagged']} of {found['rows']} rows flagged"]
    if inverse:
        bands = found["band"] if "here" not in found["band"] else {"": found["band"]}
        lines += [band_line(name, band) for name, band in bands.items()]
    lines.append(found["file"])
    print_result(found, as_json, [*warnings(found["notes"], "Note"), *lines])


def band_line(name: str, band: dict[str, float | None]) -> str:
    """What the 90 % band of a compensator holds."""
    parts = {"held_out": "the fit's held-out rows", "here": "this file's"}
    said = [f"{100 * x:.3g} % of {w}" for k, w in parts.items() if (x := band[k]) is not None]
    head = f"{name}: " if name else ""
    text = (
        f"{head}The 90 % band holds {' and '.join(said) if said else 'a share that is not known'}."
    )
    before = band["before"]
    if before is None or before == band["held_out"]:
        return text
    return f"{text} It was widened, because as learnt from the training rows it held {100 * before:.3g} %."


@takes_selection("where", "nan", "segments", *OF_READING, optional=True)
def qualify(
    folder: Folder,
    file: File,
    selection: dict[str, Any],
    max_error: Annotated[
        float | None, typer.Option(help="Largest error that is allowed, in the unit of the input.")
    ] = None,
    rate: Annotated[
        float | None,
        typer.Option(help="Samples per second that the compensator must keep up with."),
    ] = None,
    target: Annotated[
        str,
        typer.Option(
            metavar="c|python",
            help="What must keep up with --rate: the header, or plain Python here.",
        ),
    ] = "c",
    mhz: Annotated[
        float | None,
        typer.Option(
            help="Clock of the processor that runs the header; an operation is taken for a cycle."
        ),
    ] = None,
    guarantee: Annotated[
        float | None,
        typer.Option(
            help="Probability, as 0.9, with which a band is to hold a whole new run; its width is found"
            " from the runs or cycles of FILE."
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Judge a fit's compensator on data it has not seen.

    The verdict is PASS, CAUTION or FAIL; FAIL, and exit status 2, where the compensator does not meet
    --max-error or --rate. --where, --nan and how the file is read are by default those of the fit.
    """
    start_jax()
    from ..operations import _qualify  # after JAX is set up

    with Progress("qualify", later=True) as progress:
        found = _qualify.qualify(
            folder, file, max_error=max_error, rate=rate, target=target, mhz=mhz, guarantee=guarantee,
            changes=selection, tell=progress,
        )  # fmt: skip
    lines = [*warnings(found["notes"], "Note"), found.pop("text"), found["file"]]
    print_result(found, as_json, lines)
    if found["verdict"]["level"] == "FAIL":
        raise SystemExit(USER)  # stdout says why; the command itself did not fail


@takes_selection("where", "nan", "segments", *OF_READING, optional=True)
def monitor(
    folder: Folder,
    file: File,
    selection: dict[str, Any],
    reference: Annotated[
        str | None,
        typer.Option(
            help="Column of the known inputs, empty where they are not known (default: the fit's input)."
        ),
    ] = None,
    drift: Annotated[
        float,
        typer.Option(
            min=0.0,
            help="Standard deviation of the drift of the zero that is expected, in the unit of the output"
            " per unit of time.",
        ),
    ] = 0.0,
    false_alarms: Annotated[
        float, typer.Option(help="Rate of false alarms that is allowed, per independent reference.")
    ] = 1e-5,
    as_json: AsJson = False,
) -> None:
    """Run a fit's compensator over a log, and let it recalibrate itself where the input is known.

    It says whether a calibration is needed now, why, and how much accuracy is lost until then. --where,
    --nan and how the file is read are by default those of the fit.
    """
    start_jax()
    from ..operations import _monitor  # after JAX is set up

    found = _monitor.monitor(
        folder, file, reference=reference, drift=drift, false_alarms=false_alarms, changes=selection
    )
    lines = [*warnings(found["notes"], "Note"), found.pop("text"), found["file"]]
    print_result(found, as_json, lines)
