"""The vectors of a MAT-file of version 5 to 7.2: a program of its own, started by `_apart`."""

import io
import json
from collections.abc import Iterator
from typing import Any

import numpy as np

_WIDEST = 64
"""Columns above which a matrix is an image or a map, not a table."""


def read(file: bytes) -> bytes:
    """The vectors of all groups as an archive; `said` in it holds their names and units."""
    from scipy.io import loadmat  # a tenth of a second, for this alone

    variables = loadmat(io.BytesIO(file), simplify_cells=True)
    units: dict[str, str] = {}
    found = {name: x for name, x in variables.items() if not name.startswith("__")}
    groups = [(name, {key: x for key, x in own.items() if not x.dtype.hasobject})
              for name, own in _groups("", found, units)]  # fmt: skip
    said = {"groups": {name: [*own] for name, own in groups}, "units": units}
    packed = io.BytesIO()
    listed = [x for _, own in groups for x in own.values()]
    np.savez(packed, *listed, said=np.frombuffer(json.dumps(said).encode(), np.uint8))
    return packed.getvalue()


def _groups(
    name: str, found: dict[str, Any], units: dict[str, str]
) -> Iterator[tuple[str, dict[str, np.ndarray]]]:
    """A structure as a group of vectors, and the structures within it.

    Structures that hold a name and values, as those of Simulink and dSPACE, are vectors of the group.
    """
    from scipy.sparse import issparse  # as `loadmat`

    group: dict[str, np.ndarray] = {}
    listed = [words for value in found.values() if (words := _words(value))]
    for key, value in found.items():
        inner = f"{name}.{key}" if name else key
        is_list = isinstance(value, list) or (
            isinstance(value, np.ndarray) and value.dtype == object
        )
        structures = [one for one in value if isinstance(one, dict)] if is_list else []
        structures = [value] if isinstance(value, dict) else structures
        signals = [_signal(one) for one in structures]
        if signals and all(signals):
            for label, unit, x in filter(None, signals):
                group[label] = x
                if unit:
                    units[label] = unit
        elif isinstance(value, dict):
            yield from _groups(inner, value, units)
        elif structures:
            for k, one in enumerate(structures, 1):
                yield from _groups(f"{inner} {k}", one, units)
        elif isinstance(value, np.ndarray) and not is_list:
            columns = vectors(key, value)
            fits = [words for words in listed if value.ndim == 2 and len(words) == len(columns)]
            group |= dict(zip(next(iter(fits), columns), columns.values(), strict=True))
        elif is_list or issparse(value):
            group[key] = unread(len(value) if is_list else 0)
    if group:
        yield name, group


def _signal(found: dict[str, Any]) -> tuple[str, str, np.ndarray] | None:
    """Name, unit and values of a structure that holds one vector under its name; None of any other."""
    fields = {key.lower(): value for key, value in found.items()}
    said = [fields[key] for key in ("name", "label") if isinstance(fields.get(key), str)]
    values = [fields[key] for key in ("data", "values", "value") if key in fields]
    if not any(said) or len(values) != 1 or not isinstance(values[0], np.ndarray):
        return None
    x = np.squeeze(values[0])
    units = [fields[key] for key in ("unit", "units") if isinstance(fields.get(key), str)]
    good = x.ndim == 1 and x.dtype.kind in "biuf" and len(x) > 1
    return (next(filter(None, said)), "".join(units[:1]), x) if good else None


def _words(value: Any) -> list[str]:
    """The words of a list of names, all different; [] of anything else."""
    if not isinstance(value, list) and not (isinstance(value, np.ndarray) and value.ndim == 1):
        return []
    words = [str(one) for one in value if isinstance(one, str) and one.strip()]
    return words if len(words) == len(value) == len(set(words)) else []


def unread(shape: int | tuple[int, ...]) -> np.ndarray:
    """What stands for an array that no column is made of, which is told where it has as many rows as the
    columns; 0 for any."""
    return np.broadcast_to(np.bytes_(b""), shape)


def vectors(name: str, x: np.ndarray) -> dict[str, np.ndarray]:
    """A vector, the fields of records, or the columns of a matrix."""
    if x.dtype.names:
        return {field: np.asarray(x[field]).ravel() for field in x.dtype.names}
    x = np.squeeze(x)
    if x.dtype.kind not in "biufc":
        return {name: unread(len(x))} if x.ndim == 1 else {}
    if x.ndim == 1:
        return {name: x}
    if x.ndim == 2 and x.shape[1] <= min(_WIDEST, x.shape[0]):
        return {f"{name} {k}": column for k, column in enumerate(x.T, 1)}
    return {}
