"""`hysid.fit`: `identify.fit` of a record, of two arrays, or of columns of a file or a data frame; and
`hysid.records`: the records that the commands make of a file."""

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

import identify
from hysteresis import InputError, Record, read_csv
from hysteresis._precision import in_double
from hysteresis._registry import similar
from hysteresis.records._csv import turned

from ._compensator import fitted_to_compensate
from ._compile_cache import keep_compiled
from .intake._options import FIELDS
from .intake._selection import fits_option, selection_of

_OF_RECORDS = (
    "dt", "groups", "mask", "nan", "segments", "input_unit", "output_unit", "time_unit", "input_name",
    "output_name", "sigma",
)  # fmt: skip


@in_double
def fit(
    data: Any,
    other: Any = None,
    model: Any = None,
    *,
    input: Any = None,
    output: Any = None,
    time: Any = None,
    group: Any = None,
    condition: Any = (),
    turn: str | Sequence[str] = (),
    **options: Any,
) -> identify.FitResult:
    """Fit models to measurements and return the best fit.

        fit(record, model)    fit(x, y, "Preisach")    fit(frame, input="force (N)", output="x (mm)")

    **Arguments:**

    - `data`: a `Record`; or the inputs (n,), with the outputs (n,) as second argument; or a pandas or
      polars data frame, a mapping of columns, or the path of a file that `read_csv` reads, with the names
      of `input`, `output`, `time` and `group`.
    - `other`: the model beside a record, or the outputs (n,) beside an array.
    - `condition`: columns, such as a temperature, on which the output depends too.
    - `turn`: columns whose sign is turned.
    - `time`: the times (n,) of arrays, or the name of a column. Without it the fit is rate-independent.
    - `model`: "auto", names, or a model to start from, as in `identify.fit`.
    - `options`: those of `Record.from_arrays` (`dt`, `nan`, `sigma`, ...) and of `identify.fit`
      (`test_cycles`, `noise`, `parameters`, `purpose`, ...). With `purpose="compensate"` the compensator is
      tried too, and the verdict is FAIL where a straight line is better, CAUTION where only a cubic for
      either way of the output is.

    **Returns:** the `FitResult`.

    The fit is made in double precision, in which its results compute too. JAX's own precision stays.

    Compiled programs are kept in the user's cache folder, as the command line keeps them, so that the first
    fit of the next process does not wait for them. A folder given to JAX is taken instead, and
    `JAX_ENABLE_COMPILATION_CACHE=0` keeps none.

    **Raises:** `InputError` as `Record.from_arrays`, `Record.from_columns`, `read_csv` and `identify.fit`
    do.

    **Example:**

        >>> hysid.fit(record.input, record.output, model="LinearSponge", noise="gaussian").name
        'LinearSponge'
    """
    if refused := keep_compiled():
        warnings.warn(refused, stacklevel=3)
    if isinstance(data, Record):
        if (input, output, time, group) != (None,) * 4 or condition or turn:
            raise InputError(
                "bad-option",
                "A record has its input, output and time already.",
                fix="leave input=, output=, time=, group=, condition= and turn= out.",
            )
        chosen = model if other is None else other
        return fitted_to_compensate(data, "auto" if chosen is None else chosen, **options)
    own = {key: options.pop(key) for key in _OF_RECORDS if key in options}
    if output is not None and input is not None:
        if isinstance(data, str | Path):
            record = read_csv(data, input, output, time, group=group, condition=condition, **own)
        else:
            record = Record.from_columns(data, input, output, time, group, condition, **own)
        record = turned(record, turn) if turn else record
        model = other if model is None else model
    elif other is not None and not isinstance(other, str):
        record = Record.from_arrays(data, other, time, **own)
    else:
        raise InputError(
            "bad-option",
            f"fit() cannot tell input and output in a {type(data).__name__}.",
            fix="fit(record), fit(x, y), or fit(frame or file, input=NAME, output=NAME).",
        )
    if len(record) and not record.channels and np.array_equal(record.input, record.output):
        raise InputError(
            "given-twice",
            "Input and output are the same numbers.",
            fix="give what drives, and what answers.",
        )
    return fitted_to_compensate(record, "auto" if model is None else model, **options)


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
