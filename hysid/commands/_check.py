"""`hysid check`: what is in a record, and what makes a model hard to identify from it."""

from typing import Any

from hysteresis import InputError
from hysteresis.records._excitation import check_identifiable

from ..intake._creep_fits import check_step
from ..intake._selection import Selection, all_of
from ._asked import Check
from ._console import Done, warnings


def run(asked: Check) -> Done:
    """What is in a record, whether a model can be identified from it, and what to mind."""
    selection = Selection(**asked.selection)
    selection.check_columns()
    records, faults = selection.without_hold_out().records(selection.read(asked.file))
    found: dict[str, Any] = {}
    for value, (record, _) in records.items():
        try:
            if selection.is_step:
                found[value] = check_step(record)
                continue
            known = {"text": record.describe(), "warnings": check_identifiable(record)}
            found[value] = known | record.summary()
        except InputError as error:
            faults[value] = error
    if not found:
        raise all_of(faults)
    each, lines = selection.each, []
    for value, one in found.items():
        lines += [f"{each} = {value}"] if value else []
        lines += [one.pop("text"), *warnings(one["warnings"])]
    if "" in found:
        return Done(found[""], lines)
    failed = {value: str(error) for value, error in faults.items()}
    lines += [f"{each} = {v} cannot be used: {e}" for v, e in failed.items()]
    return Done({"each": found, "failed": failed}, lines)
