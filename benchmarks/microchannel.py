"""The microchannel sensor: forces, places, several contacts; virtual sensors and measured ones.

python -m benchmarks.microchannel [--quick] [--json] [--only TEXT]

Parts: forces (of one contact and of two: trains networks, minutes), places (which, and which several),
real (measured sensors, need the data).
"""

import sys
from collections.abc import Callable, Sequence

from ._measure import Row, run_parts
from ._microchannel_forces import force_rows
from ._microchannel_places import place_rows
from ._microchannel_real import real_rows

PARTS: dict[str, Callable[[bool], list[Row]]] = {
    "forces": force_rows,
    "places": place_rows,
    "real": real_rows,
}


def main(arguments: Sequence[str] | None = None) -> None:
    """Run every part and print."""
    run_parts("benchmarks.microchannel", __doc__, PARTS, arguments)


if __name__ == "__main__":
    main(sys.argv[1:])
