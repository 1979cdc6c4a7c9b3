"""Whether what identification says can be believed, and what it costs.

python -m benchmarks.identification [--quick] [--json] [--only TEXT]

Parts: calibration (coverage and ranks of simulated records), check (with lmfit and iminuit), shown (three
fits that must not be believed), starts, sampling, kill, batch. The full study takes most of an hour.
"""

import os
import sys
from collections.abc import Callable, Sequence
from importlib import import_module

for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")  # small matrices; workers inherit it

import jax  # noqa: E402

from ._measure import Row, options, report  # noqa: E402

PARTS = {
    "calibration": ("_calibration", "calibration_rows"),
    "check": ("_cross_check", "cross_check_rows"),
    "shown": ("_cases", "case_rows"),
    "starts": ("_starts", "start_rows"),
    "sampling": ("_sampling", "sampling_rows"),
    "kill": ("_sampling", "kill_rows"),
    "batch": ("_batches", "batch_rows"),
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run every part and print; the exit status."""
    chosen = options(
        "benchmarks.identification", __doc__, arguments, only="parts with this in their name"
    )
    jax.config.update("jax_enable_x64", True)
    rows: list[Row] = []
    for name, (module, function) in PARTS.items():
        if (chosen.only or "") in name:
            part: Callable[[bool], list[Row]] = getattr(
                import_module(f"benchmarks.{module}"), function
            )
            print(f"{name} ...", file=sys.stderr, flush=True)
            rows += part(chosen.quick)
    report(rows, chosen.json)
    return 0


if __name__ == "__main__":
    sys.exit(main())
