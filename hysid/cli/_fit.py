"""`hysid fit`."""

from pathlib import Path
from typing import Annotated, Any

import typer

from ._config_file import Config, parameters_said
from ._console import (
    AsJson,
    File,
    Overwrite,
    Seed,
    candidate_lines,
    compensator_lines,
    log,
    one_of,
    print_result,
    start_jax,
    verdict_lines,
)  # fmt: skip
from ._selection import takes_selection

MODELS = (
    "LinearSponge", "Burgers", "Preisach", "EverettSurface", "Composition", "Butterfly", "FoamCurve",
    "BoucWen", "PrandtlIshlinskii", "DegradingBoucWen", "StandardLinearSolid", "GeneralizedKelvinVoigt",
    "GeneralizedMaxwell", "DuhemOperator", "GaussianPreisach", "TwoGaussianPreisach",
    "LorentzianPreisach", "LogNormalPreisach", "Oscillator",
)  # fmt: skip
"""Our own names of `--model`, written here because `--help` does not wait for JAX; a test compares them."""


@takes_selection()
def fit(
    file: File,
    selection: dict[str, Any],
    out: Annotated[
        Path | None,
        typer.Option("--out", help="Folder for the results (default: FILE without its suffix)."),
    ] = None,
    config: Config = None,
    model: Annotated[
        str,
        typer.Option(
            help=f"auto, or NAME[,NAME], in any case: {', '.join(MODELS)}, or a model of an installed"
            " distribution (entry-point group hysid.models)."
        ),
    ] = "auto",
    initial: Annotated[
        str,
        typer.Option(
            callback=one_of("auto", "negative", "positive", "demagnetised", "fit"),
            help="Memory before the first sample: auto, negative, positive, demagnetised, or fit.",
        ),
    ] = "auto",
    conditioning: Annotated[
        str,
        typer.Option(
            callback=one_of("auto", "keep"),
            help="auto: exclude the first cycle where that predicts better; keep: never exclude it.",
        ),
    ] = "auto",
    clocks: Annotated[
        str,
        typer.Option(
            callback=one_of("auto", "keep"),
            help="auto: correct a lag between input and output and smooth a staircase; keep: change"
            " nothing.",
        ),
    ] = "auto",
    drift: Annotated[
        str,
        typer.Option(
            callback=one_of("auto", "keep"),
            help="auto: a drift explains the training rows and is not in the model; keep: it is in the"
            " model, and stops at its last value.",
        ),
    ] = "auto",
    noise: Annotated[
        str,
        typer.Option(
            help="Noise model: auto, or gaussian, student-t, ar1, arma11, growing, input, misfit,"
            " joined with +."
        ),
    ] = "auto",
    parameter: Annotated[
        list[str] | None,
        typer.Option(
            help='What is known of a parameter; repeatable: "E1 start=2 bounds=1,4", "b fixed=0",'
            ' "K prior=normal(1, 0.1)", "E2 tied=2 * E1".'
        ),
    ] = None,
    starts: Annotated[
        int, typer.Option(min=1, help="Random starts for non-linear parameters.")
    ] = 32,
    seed: Seed = 0,
    purpose: Annotated[
        str,
        typer.Option(
            callback=one_of("predict", "compensate", "constants"),
            help="What the verdict is for: predict; compensate, which tries the compensator too; or"
            " constants, which needs a standard error for every parameter.",
        ),
    ] = "predict",
    period: Annotated[
        int | None,
        typer.Option(
            min=0,
            help="Oscillator: rows in a period of the force, in steady state; 0: it does not repeat"
            " (default: looked for).",
        ),
    ] = None,
    oversampling: Annotated[
        int, typer.Option(min=1, help="Oscillator: steps of integration to a sample.")
    ] = 20,
    allow_float32: Annotated[
        bool,
        typer.Option("--allow-float32", help="Fit in single precision; standard errors are rough."),
    ] = False,
    overwrite: Overwrite = False,
    as_json: AsJson = False,
) -> None:
    """Fit models to a record, judge the best one, and write it to a folder.

    FILE alone is enough where its columns are plain: hysid chooses them, says why, and keeps its choice in
    FILE's .toml, whose options it takes from then on. Models are ranked by their errors on rows that were
    held out from the fit.
    """
    start_jax(double=not allow_float32)
    from ..intake._own_config import folder_of  # after JAX is set up
    from ..intake._selection import Selection
    from ..operations import _fit

    out = out or folder_of(file)
    document = _fit.fit(
        file, Selection(**selection), out, overwrite=overwrite, say=log, model=model, initial=initial,
        conditioning=conditioning, clocks=clocks, drift=drift, noise=noise, starts=starts,
        seed=seed, purpose=purpose, allow_float32=allow_float32,
        parameters=parameters_said(config, parameter), period=period, oversampling=oversampling,
    )  # fmt: skip
    lines = verdict_lines(document)
    if "each" not in document:
        lines += candidate_lines(document) + compensator_lines(document)
    print_result(document, as_json, [*lines, f"Results: {out}"])
