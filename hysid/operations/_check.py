"""`hysid check`: what is in a record, and what makes a model hard to identify from it."""

from pathlib import Path
from typing import Any

from hysteresis import InputError, Record, check_identifiable

from ..intake._creep_fits import check_step
from ..intake._selection import Selection, all_of


def check(file: Path, selection: Selection) -> dict[str, Any]:
    """What is in a record, whether a model can be identified from it, and what to mind."""
    selection.check_columns()
    records, faults = selection.without_hold_out().records(selection.read(file))
    found: dict[str, Any] = {}
    for value, (record, _) in records.items():
        try:
            found[value] = check_step(record) if selection.is_step else _looked_at(record)
        except InputError as error:
            faults[value] = error
    if not found:
        raise all_of(faults)
    if "" in found:
        return found[""]
    return {"each": found, "failed": {value: str(error) for value, error in faults.items()}}


def _looked_at(record: Record) -> dict[str, Any]:
    warnings = check_identifiable(record)
    return {"text": record.describe(), "warnings": warnings, **record.summary()}
