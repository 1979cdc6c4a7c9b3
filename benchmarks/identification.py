"""Whether what identification says can be believed, and what it costs.

python -m benchmarks.identification [--quick] [--json] [--only TEXT]

Parts: calibration (coverage and ranks of simulated records), sums (coverage of the sums of a grid, by its
fit and its posterior), compositions (the same of theirs), check (with lmfit and iminuit), shown (three fits
that must not be believed), starts, sampling, kill, batch, reports. Sums and compositions take 17 minutes
of processor time.
"""

import os
import sys
from collections.abc import Callable, Sequence
from importlib import import_module

for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")  # small matrices; workers inherit it

from ._measure import Row, run_parts  # noqa: E402


def _part(module: str, function: str) -> Callable[[bool], list[Row]]:
    """Loaded when it is run."""
    return lambda quick: getattr(import_module(f"benchmarks._identification.{module}"), function)(
        quick
    )


PARTS = {
    "calibration": _part("calibration", "calibration_rows"),
    "sums": _part("sums", "sums_rows"),
    "compositions": _part("sums", "composition_rows"),
    "check": _part("cross_check", "cross_check_rows"),
    "shown": _part("cases", "case_rows"),
    "starts": _part("starts", "start_rows"),
    "sampling": _part("sampling", "sampling_rows"),
    "kill": _part("sampling", "kill_rows"),
    "batch": _part("batches", "batch_rows"),
    "reports": _part("reports", "report_rows"),
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run every part and print; the exit status."""
    run_parts("benchmarks.identification", __doc__, PARTS, arguments)
    return 0


if __name__ == "__main__":
    sys.exit(main())
