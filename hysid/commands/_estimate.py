"""`hysid microchannel estimate`: a trained sensor, or pairs, over a file."""

from typing import Any

from hysteresis._format import quantity, rms_error

from ..soft_sensor import _estimate
from ..soft_sensor._estimate import confusion_lines
from . import _pairs
from ._asked_more import Estimate
from ._console import Done, warnings
from ._pairs import contact_lines


def estimate(asked: Estimate) -> Done:
    """A trained sensor, or pairs, over a file."""
    given = asked.folder, asked.file, asked.out
    if (asked.folder / _pairs.DOCUMENT).is_file():
        document = _pairs.estimate_contacts(*given, **asked.selection)
    else:
        document = _estimate.estimate(*given, **asked.selection)
    return Done(document, _estimated_lines(document))


def figure_lines(figures: dict[str, Any]) -> list[str]:
    lines = []
    if (force := figures.get("force")) is not None:
        lines.append(f"force: {rms_error(force, force['unit'])}")
    if (place := figures.get("place")) is not None:
        lines.append(f"place: {place['accuracy']:.1%} of {place['rows']} rows correct")
        lines += [f"  {line}" for line in confusion_lines(place["confusion"])]
        if place["rows_at_rest"]:
            lines.append(
                f"  {place['rest_taken_for_a_place']} of {place['rows_at_rest']} rows without a place"
                " were assigned one"
            )
    if (position := figures.get("position")) is not None:
        lines.append(
            f"position: mean error {quantity(position['mean_error'], position['unit'], 3)},"
            f" 95 % within {quantity(position['q95_error'], position['unit'], 3)}"
        )
    return lines


def _estimated_lines(document: dict[str, Any]) -> list[str]:
    lines = warnings(document["notes"])
    for channel, faults in document["channels_at_fault"].items():
        said = ", ".join(f"{fault} in {n} rows" for fault, n in faults.items())
        lines += warnings([f"{channel}: {said}."])
    figures = {k: document[k] for k in ("place", "position") if k in document}
    lines += contact_lines(document.get("contacts"))
    if document["rmse"] is not None:
        figures["force"] = document
    if not document.get("contacts"):
        lines += figure_lines(figures) or ["The file has no measured values to compare with."]
    return [*lines, f"{document['flagged']} of {document['rows']} rows flagged", document["file"]]
