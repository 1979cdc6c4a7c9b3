"""The microchannel sensor: forces, places, several contacts; virtual sensors and measured ones.

python -m benchmarks.microchannel [--quick] [--json] [--only TEXT]

Parts: forces (of one contact and of two: trains networks, minutes), places (which, and which several),
real (measured sensors, need the data).
"""

import sys
from collections.abc import Callable, Sequence

import jax

from ._measure import Row, options, report
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
    chosen = options(
        "benchmarks.microchannel", __doc__, arguments, only="parts with this in their name"
    )
    jax.config.update("jax_enable_x64", True)
    rows: list[Row] = []
    for name, part in PARTS.items():
        if (chosen.only or "") in name:
            print(f"{name} ...", file=sys.stderr, flush=True)
            rows += part(chosen.quick)
    report(rows, chosen.json)


if __name__ == "__main__":
    main(sys.argv[1:])
