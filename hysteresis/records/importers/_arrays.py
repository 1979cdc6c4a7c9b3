"""Named arrays of a binary file as one table: those of one length are columns, groups are told apart."""

from collections.abc import Mapping

import numpy as np

from ..._errors import InputError
from ..._note import Note
from ._sheet import Sheet, distinct

Group = Mapping[str, np.ndarray]
"""Arrays (n,) of numbers or words by name, of one length or of several."""


def sheet_of_arrays(
    groups: Mapping[str, Group],
    units: Mapping[str, str],
    said: str,
    column: str = "group",
    table: int | None = None,
) -> Sheet | None:
    """Groups of arrays as one sheet, None without an array of two values.

    The arrays of the commonest length are the columns of a group. Groups with the same columns are put
    under one another and told apart by `column`; of others the one with most rows is meant, or `table`.

    `units`: by the name of an array. `said`: the kind of file, for the notes.

    Raises `InputError` `bad-option` where there is no such table.
    """
    notes = [Note("format", f"Read as {said}.")]
    tables: dict[str, dict[str, np.ndarray]] = {}
    for name, arrays in groups.items():
        lengths = [len(x) for x in arrays.values() if len(x) > 1]
        if not lengths:
            continue
        rows = max(lengths, key=lambda n: (lengths.count(n), n))
        tables[name] = {key: x for key, x in arrays.items() if len(x) == rows}
        if other := {key: len(x) for key, x in arrays.items() if 1 < len(x) != rows}:
            left = ", ".join(f"{key!r} ({n})" for key, n in list(other.items())[:8])
            notes.append(Note("skipped", f"Left out arrays that have not {rows} values: {left}."))
    if not tables:
        return None
    families: dict[tuple[str, ...], list[str]] = {}
    for name, arrays in tables.items():
        families.setdefault(tuple(arrays), []).append(name)
    listed = list(families.items())
    sizes = [sum(len(tables[n][keys[0]]) for n in names) for keys, names in listed]
    at = int(np.argmax(sizes)) if table is None else table - 1
    if not 0 <= at < len(listed):
        problem = f"The file has {len(listed)} tables, and table {table} is asked for."
        raise InputError("bad-option", problem, fix=f"--table 1 to {len(listed)}.")
    keys, chosen = listed[at]
    names = distinct(keys)
    columns = {
        n: np.concatenate([tables[g][k] for g in chosen]) for n, k in zip(names, keys, strict=True)
    }
    if len(chosen) > 1:
        (label,) = distinct([column], names)
        runs = np.repeat(np.array(chosen), [len(tables[g][keys[0]]) for g in chosen])
        columns = {label: runs} | columns
        joined = f"Put {len(chosen)} groups under one another, told apart by {label!r}."
        notes.append(Note("joined", joined))
    if others := [name for name in tables if name not in chosen]:
        left = f"Left out groups with other channels: {', '.join(others)}. --table N reads one."
        notes.append(Note("skipped", left))
    written = {n: units[k] for n, k in zip(names, keys, strict=True) if units.get(k)}
    return Sheet(columns, np.arange(1, sizes[at] + 1), written, tuple(notes))
