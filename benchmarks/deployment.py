"""Exports where they run: the same bits everywhere, sizes, cycles and instructions.

python -m benchmarks.deployment [--quick] [--json] [--only TEXT]

Parts: identity (every target against the C99 header, bit by bit), units (FMUs: validation, size, time from
a CSV), boards (cycles and memory of an ATmega328, instructions of a Cortex-M4).
"""

import sys
from collections.abc import Callable, Sequence

from ._deployment.boards import boards
from ._deployment.identity import identity
from ._deployment.units import units
from ._measure import Row, run_parts

PARTS: dict[str, Callable[[bool], list[Row]]] = {
    "identity": identity, "units": units, "boards": boards,
}  # fmt: skip


def main(arguments: Sequence[str] | None = None) -> None:
    """Run every part and print."""
    run_parts("benchmarks.deployment", __doc__, PARTS, arguments)


if __name__ == "__main__":
    main(sys.argv[1:])
