"""Compensators in the loop: how they stay right, and what their bands hold.

python -m benchmarks.deployment [--quick] [--json] [--only TEXT]
"""

import sys
from collections.abc import Callable, Sequence

from ._deployment.coverage import coverage_rows
from ._deployment.measured_drift import measured_drift_rows
from ._deployment.virtual_change import virtual_change_rows
from ._measure import Row, run_parts

PARTS: dict[str, Callable[[bool], list[Row]]] = {
    "change": virtual_change_rows,
    "measured": measured_drift_rows,
    "coverage": coverage_rows,
}


def main(arguments: Sequence[str] | None = None) -> None:
    """Run every part and print."""
    run_parts("benchmarks.deployment", __doc__, PARTS, arguments)


if __name__ == "__main__":
    main(sys.argv[1:])
