"""Compensators in the loop: exports where they run, self-recalibration, guaranteed bands, estimators.

python -m benchmarks.deployment [--quick] [--json] [--only TEXT]

Parts: identity (every target against the C99 header, bit by bit), units (FMUs: validation, size, time from
a CSV), boards (cycles and memory of an ATmega328, instructions of a Cortex-M4), change and measured
(self-recalibration on a virtual sponge and on measured runs), coverage (of guaranteed bands), estimators.
"""

import sys
from collections.abc import Callable, Sequence

from ._deployment.boards import boards
from ._deployment.coverage import coverage_rows
from ._deployment.estimators import estimator_rows
from ._deployment.identity import identity
from ._deployment.measured_drift import measured_drift_rows
from ._deployment.units import units
from ._deployment.virtual_change import virtual_change_rows
from ._measure import Row, run_parts

PARTS: dict[str, Callable[[bool], list[Row]]] = {
    "identity": identity, "units": units, "boards": boards, "change": virtual_change_rows,
    "measured": measured_drift_rows, "coverage": coverage_rows, "estimators": estimator_rows,
}  # fmt: skip


def main(arguments: Sequence[str] | None = None) -> None:
    """Run every part and print."""
    run_parts("benchmarks.deployment", __doc__, PARTS, arguments)


if __name__ == "__main__":
    main(sys.argv[1:])
