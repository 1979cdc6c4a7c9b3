"""`hysid demo`."""

from pathlib import Path

from ._console import AsJson, Out, Progress, log, print_result, start_jax, verdict_lines


def demo(out: Out = Path("hysid-demo"), as_json: AsJson = False) -> None:
    """Run fit, posterior, compensator and report on a shipped record."""
    log("hysid demo: loading JAX")
    start_jax()
    from ..operations import _demo  # after JAX is set up

    with Progress("sampling") as progress:
        document = _demo.demo(out, log, progress)
    backwards = document["inverse"]
    lines = [
        *verdict_lines(document),
        f"Compensator, displacement -> force, over all rows: {backwards['rmse']:.3g} N rms"
        f" ({backwards['nrmse_percent']:.2g} % of the range), {backwards['flagged']} flagged.",
        f"Report: {document['report']}",
    ]
    print_result(document, as_json, lines)
