"""The microchannel sensor: forces, places, several contacts; virtual sensors and measured ones.

python -m benchmarks.microchannel [--quick] [--json] [--only TEXT]

Parts: forces (of one contact: trains networks, minutes), pairs (of two contacts: minutes), electronics
(what each part costs in force), training (how
long it takes), places (which, and which several), recovery (two contacts, runs that lock up), separation
(two places by independent components, beside ours), control (force loops at 1 kHz), real (measured sensors,
need the data), runtime (force estimators without JAX).
"""

import sys
from collections.abc import Callable, Sequence

from ._measure import Row, run_parts
from ._microchannel.control import control_rows
from ._microchannel.forces import electronics_rows, force_rows, pair_rows
from ._microchannel.places import place_rows
from ._microchannel.real import real_rows
from ._microchannel.recovery import recovery_rows
from ._microchannel.runtime import runtime_rows
from ._microchannel.separation import separation_rows
from ._microchannel.training import training_rows

PARTS: dict[str, Callable[[bool], list[Row]]] = {
    "forces": force_rows,
    "pairs": pair_rows,
    "electronics": electronics_rows,
    "training": training_rows,
    "places": place_rows,
    "recovery": recovery_rows,
    "separation": separation_rows,
    "control": control_rows,
    "real": real_rows,
    "runtime": runtime_rows,
}


def main(arguments: Sequence[str] | None = None) -> None:
    """Run every part and print."""
    run_parts("benchmarks.microchannel", __doc__, PARTS, arguments)


if __name__ == "__main__":
    main(sys.argv[1:])
