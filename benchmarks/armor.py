"""The armor: exactness and speed of the contact solver, the paper's numbers, errors after a calibration.

python -m benchmarks.armor [--quick] [--json] [--only TEXT]

Parts: contacts (solver), reproduced (the paper's numbers over virtual rigs), split (what each addition
to the published method brings), classes (no class of models contains a rig), errors (after twenty presses,
with ellipsoids: minutes), ageing (whether a sponge has changed, in pairs of records).
"""

import sys
from collections.abc import Callable, Sequence

from hysid.reproduction._armor import PAPER, Rig
from hysid.reproduction._frame import compared

from ._armor.ageing import ageing_rows
from ._armor.classes import class_rows
from ._armor.contacts import contact_rows
from ._armor.errors import error_rows
from ._armor.split import split_rows
from ._measure import Row, judged, noted, run_parts

RIGS = 60


def reproduced_rows(quick: bool) -> list[Row]:
    """Every published number beside the virtual rigs', with its label."""
    count = 10 if quick else RIGS
    found = compared(PAPER.published, [Rig(seed) for seed in range(count)], with_ours=False)
    labelled = sum(bool(row["label"] and row["where"] and row["differs"]) for row in found)
    rows = [
        judged(
            "reproduction: rows with their label, %",
            100 * labelled / len(found),
            100,
            at_least=True,
        )
    ]
    for row in found:
        sign = "<" if row["at_most"] else ""
        published = f"{sign}{row['published']:g} {row['unit']} published"
        what = f"reproduced numbers, mean over {count} rigs: {row['what']}, {published}"
        within = "within" if row["within"] else "outside"
        rows.append(
            noted(what, row["reproduced"], reason=f"{row['label']}, {within} the tolerance")
        )
    return rows


PARTS: dict[str, Callable[[bool], list[Row]]] = {
    "contacts": contact_rows,
    "reproduced": reproduced_rows,
    "split": split_rows,
    "classes": class_rows,
    "errors": error_rows,
    "ageing": ageing_rows,
}


def main(arguments: Sequence[str] | None = None) -> None:
    """Run every part and print."""
    run_parts("benchmarks.armor", __doc__, PARTS, arguments)


if __name__ == "__main__":
    main(sys.argv[1:])
