"""`hysid microchannel train-pairs` and `estimate`: forces on several places, and sensors over files."""

from typing import Any

import typer

from ..intake._selection import Selection
from ..soft_sensor import _contacts_command, _estimate, _estimate_fit
from ..soft_sensor._estimate import confusion_lines
from ._asked_more import Estimate, TrainPairs
from ._console import Done, Progress, log, warnings


def train_pairs(asked: TrainPairs) -> Done:
    """An estimator of the forces on several places."""
    chosen = Selection(**asked.selection, output=asked.force[0])
    with Progress("training") as progress:
        document = _contacts_command.train_pairs(
            asked.files, chosen, asked.force, asked.out, noise=asked.noise, high=asked.high,
            epochs=asked.epochs, seed=asked.seed, overwrite=asked.overwrite, say=log,
            progress=progress,
        )  # fmt: skip
    lines = [*warnings(document["notes"]), *_contact_lines(document["metrics"])]
    return Done(document, [*lines, f"Estimator: {asked.out}"])


def estimate(asked: Estimate) -> Done:
    """A trained sensor, pairs, or a fit of a force, over a file."""
    given = asked.folder, asked.file, asked.out
    if _contacts_command.is_contacts(asked.folder):
        document = _contacts_command.estimate_contacts(*given, **asked.selection)
    elif _estimate.is_plain_fit(asked.folder):
        document = _estimate_fit.estimate_by_fit(*given, asked.runtime, **asked.selection)
    elif asked.runtime is not None:
        raise typer.BadParameter("--runtime is for the folder of a fit; hysid export is for others")
    else:
        document = _estimate.estimate(*given, **asked.selection)
    return Done(document, _estimated_lines(document))


def _contact_lines(found: dict[str, Any] | None) -> list[str]:
    """Errors of each place's force."""
    return [
        f"{name}: {of['rmse']:.3g} N rms, {of['nrmse_percent']:.3g} % of the range; 90 % bands hold"
        f" {100 * of['coverage_of_90_percent_bands']:.0f} % of the rows"
        for name, of in (found or {}).items()
    ]


def figure_lines(figures: dict[str, Any]) -> list[str]:
    lines = []
    if (force := figures.get("force")) is not None:
        lines.append(f"force: {force['rmse']:.3g} rms, {force['nrmse_percent']:.3g} % of the range")
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
            f"position: mean error {position['mean_error']:.3g},"
            f" 95 % within {position['q95_error']:.3g}"
        )
    return lines


def _estimated_lines(document: dict[str, Any]) -> list[str]:
    lines = warnings(document["notes"])
    for channel, faults in document["channels_at_fault"].items():
        said = ", ".join(f"{fault} in {n} rows" for fault, n in faults.items())
        lines += warnings([f"{channel}: {said}."])
    figures = {k: document[k] for k in ("place", "position") if k in document}
    lines += _contact_lines(document.get("contacts"))
    if document["rmse"] is not None:
        figures["force"] = document
    if not document.get("contacts"):
        lines += figure_lines(figures) or ["The file has no measured values to compare with."]
    return [*lines, f"{document['flagged']} of {document['rows']} rows flagged", document["file"]]
