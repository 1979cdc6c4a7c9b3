"""`hysid.records`: the records that the commands make of a file."""

import warnings
from pathlib import Path
from typing import Any

from hysteresis import InputError, Record
from hysteresis._registry import similar

from .intake._selection import fits_option, selection_of
from .intake._selection_options import FIELDS


def records(
    file: str | Path, *, output: str, **selection: Any
) -> dict[str, tuple[Record, Record | None]]:
    """Training and test record of a file, as `hysid fit FILE` makes them with the same options.

    A constant input (`step`), a column that is held (`hold`) and a fit of each value of a column (`each`)
    need rows chosen and averaged as the commands do it. For all else `read_csv` is enough.

    **Arguments:**

    - `file`: anything that `read_table` reads.
    - `selection`: the keys of [selection] in a configuration file: `input`, `output`, `time`, `step`,
      `hold`, `each`, `where`, `test_cycles` and the others of `hysid fit --help`, each with `_` for `-`.

    **Returns:** `(train, test)` by the values of `each`, by "" without it; `test` is None where nothing is
    held out. A value whose rows cannot be used is left out, with a warning.

    **Raises:** `InputError` as `read_csv` does, and `bad-option`, `conflicting-options`, `not-a-step`,
    `no-hold`.

    **Example:**

        >>> file = datasets / "sponge-50mm-cycles.csv"
        >>> columns = {"input": "force (N)", "output": "displacement (mm)", "time": "time (s)"}
        >>> pairs = hysid.records(file, **columns, each="cycle", where=["cycle=1,2"])
        >>> {value: len(train) for value, (train, _) in pairs.items()}
        {'1': 21, '2': 20}
    """
    for name, value in selection.items():
        if not fits_option(name, value):
            meant = similar(name, tuple(FIELDS))
            fix = f"did you mean {meant}?"
            if meant in ("", name):
                fix = "give keys and values of [selection] in a configuration file."
            raise InputError("bad-option", f"records() cannot take {name}={value!r:.40}.", fix=fix)
    chosen = selection_of({"output": output, **selection})
    chosen.check_columns()
    found, faults = chosen.records(chosen.read(Path(file)))
    for value, error in faults.items():
        warnings.warn(f"{chosen.each} = {value} is left out: {error}", stacklevel=2)
    return found
