"""The armor: exactness and speed of the contact solver, the paper's numbers, errors after a calibration.

python -m benchmarks.armor [--quick] [--json] [--only TEXT]

Parts: contacts (solver), reproduced (the paper's numbers over virtual rigs), errors (after twenty presses,
with ellipsoids: minutes).
"""

import sys
from collections.abc import Callable, Sequence

from hysid.reproduction._armor import Rig
from hysid.reproduction._armor_rows import PUBLISHED
from hysid.reproduction._published import compared

from ._armor.contacts import contact_rows
from ._armor.errors import error_rows
from ._measure import Row, run_parts

RIGS = 60


def reproduced_rows(quick: bool) -> list[Row]:
    """Every published number beside the virtual rigs': off by no more than two of their deviations."""
    count = 10 if quick else RIGS
    rows = []
    for row in compared(PUBLISHED, {}, [Rig(seed) for seed in range(count)], lambda _: None):
        sign = "<" if row["at_most"] else ""
        published = f"{sign}{row['published']:g} {row['unit']} published"
        what = f"reproduced numbers, mean over {count} rigs: {row['what']}, {published}"
        reason = f"within 2 sd of {row['sd']:.2g}: {'yes' if row['within_two_sd'] else 'no'}"
        rows.append(
            Row(what, row["reproduced"], row["published"], None, row["within_two_sd"], reason)
        )
    return rows


PARTS: dict[str, Callable[[bool], list[Row]]] = {
    "contacts": contact_rows,
    "reproduced": reproduced_rows,
    "errors": error_rows,
}


def main(arguments: Sequence[str] | None = None) -> None:
    """Run every part and print."""
    run_parts("benchmarks.armor", __doc__, PARTS, arguments)


if __name__ == "__main__":
    main(sys.argv[1:])
