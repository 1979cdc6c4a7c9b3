"""`hysid demo`."""

from pathlib import Path
from typing import Any

from ._console import AsJson, Out, Progress, log, print_result, start_jax, verdict_lines


def demo(out: Out = Path("hysid-demo"), as_json: AsJson = False) -> None:
    """Run fit, posterior, compensator and report on a shipped record.

    The verdict is printed as soon as the fit is made.
    """
    log("hysid demo: loading JAX")
    start_jax()
    from ..operations import _demo  # after JAX is set up

    def fitted(document: dict[str, Any]) -> None:
        if not as_json:
            print_result(document, as_json, verdict_lines(document))

    with Progress("sampling") as progress:
        document = _demo.demo(out, log, progress, fitted)
    backwards = document["inverse"]
    lines = [
        f"Compensator, displacement -> force, over all rows: {backwards['rmse']:.3g} N rms"
        f" ({backwards['nrmse_percent']:.2g} % of the range), {backwards['flagged']} flagged.",
        *backwards["notes"],
        f"Report: {document['report']}",
    ]
    print_result(document, as_json, lines)
