"""`hysid predict`."""

from typing import Annotated, Any

import typer

from ._console import AsJson, File, Folder, print_result, start_jax, warnings
from ._selection import takes_selection


@takes_selection("where", "nan", optional=True)
def predict(
    folder: Folder,
    file: File,
    selection: dict[str, Any],
    inverse: Annotated[
        bool,
        typer.Option("--inverse", help="Run the compensator: estimate the input from the output."),
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Run a fitted model, or its compensator, over a file.

    The file has the columns that the fit used. --where and --nan are by default those of the fit.
    """
    start_jax()
    from ..operations import _predict  # after JAX is set up

    found = _predict.predict(folder, file, inverse=inverse, changes=selection)
    compared = "The file has no measured values to compare with"
    if found["rmse"] is not None:
        compared = f"{found['rmse']:.4g} rms, {found['nrmse_percent']:.3g} % of the range"
    lines = [f"{compared}; {found['flagged']} of {found['rows']} rows flagged", found["file"]]
    print_result(found, as_json, [*warnings(found["notes"], "Note"), *lines])
