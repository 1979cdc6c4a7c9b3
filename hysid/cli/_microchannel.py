"""`hysid microchannel` on the command line: what it is told, what it prints."""

import shlex
import sys
from pathlib import Path
from typing import Annotated, Any

import typer

microchannel = typer.Typer(
    help="Soft sensors: force and place from the readings of their channels.", no_args_is_help=True
)

Where = Annotated[
    list[str] | None, typer.Option(help="COL=VALUE[,VALUE]: rows to use; repeatable.")
]
NaValues = Annotated[
    str, typer.Option(help="Words that mean a missing value, with commas between.")
]
AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object.")]


@microchannel.callback()
def _microchannel() -> None:
    """Soft sensors: force and place from the readings of their channels."""


@microchannel.command()
def train(
    files: Annotated[
        list[Path], typer.Argument(metavar="FILE...", help="CSV files, each a session.")
    ],
    out: Annotated[Path, typer.Option("--out", help="Folder for the sensor.")],
    input: Annotated[
        list[str], typer.Option("--input", help="Reading of a channel; repeat it for each.")
    ],
    force: Annotated[str | None, typer.Option(help="COL: force to learn.")] = None,
    place: Annotated[
        str | None, typer.Option(help="COL: name of the pressed place, empty for none.")
    ] = None,
    position: Annotated[
        list[str] | None, typer.Option(help="COL: a coordinate of the press; repeat it for each.")
    ] = None,
    time: Annotated[str | None, typer.Option(help="Time column.")] = None,
    dt: Annotated[
        float | None, typer.Option(help="Sampling step in seconds, without a time column.")
    ] = None,
    group: Annotated[
        str, typer.Option(help="COL[,COL]: streams of their own, each from the sensor at rest.")
    ] = "",
    where: Where = None,
    test_file: Annotated[
        list[Path] | None, typer.Option(help="A session that is held out; repeatable.")
    ] = None,
    test_where: Annotated[
        list[str] | None,
        typer.Option(help="COL=VALUE[,VALUE] or COL%2=0: rows held out for testing."),
    ] = None,
    test_cycles: Annotated[
        int | None, typer.Option(min=1, help="Hold out the last N cycles of each stream.")
    ] = None,
    test_tail: Annotated[
        float | None, typer.Option(help="Hold out this last fraction of each stream.")
    ] = None,
    kind: Annotated[
        str, typer.Option(help="Of the force: network, everett, structured, or auto, the best.")
    ] = "auto",
    epochs: Annotated[
        int | None, typer.Option(min=1, help="Of each network; by default 20,000 steps of 64 rows.")
    ] = None,
    members: Annotated[
        int, typer.Option(min=2, help="Networks, each held out from another part of the rows.")
    ] = 5,
    places: Annotated[
        str, typer.Option(help="NAME[,NAME]: the places there are; those in the files by default.")
    ] = "",
    noise: Annotated[
        float | None,
        typer.Option(help="Deviation of a reading; found from the streams by default."),
    ] = None,
    range: Annotated[
        tuple[float, float] | None,
        typer.Option(help="LOW HIGH of the converter: readings there are SATURATED."),
    ] = None,
    nan: Annotated[
        str, typer.Option(help="raise, omit (mask rows without a force) or interpolate.")
    ] = "raise",
    segments: Annotated[
        str | None, typer.Option(help="auto: a new stream where time goes back.")
    ] = None,
    decimal: Annotated[str, typer.Option(help="Decimal sign of the files, . or ,")] = ".",
    units_row: Annotated[
        int | None, typer.Option(min=0, help="Line that holds units; 0 for none.")
    ] = None,
    na_values: NaValues = "",
    input_unit: Annotated[str | None, typer.Option(help="Unit of the readings.")] = None,
    force_unit: Annotated[str | None, typer.Option(help="Unit of the force.")] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of everything random.")] = 0,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on from what was kept in DIR.")
    ] = False,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Write over results that are there.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Learn a soft sensor's force, places or positions from CSV files, and write it to a folder."""
    from ._app import _print, _say, _start
    from ._config_file import selection_options

    if range is not None and not range[0] < range[1]:
        raise typer.BadParameter("--range is LOW HIGH, the lower one first")
    options = selection_options(locals() | {"output": force or "", "output_unit": force_unit})
    jobs = _start()
    from ..soft_sensor import _train as work

    settings = work.Settings(kind, epochs, members, seed, noise, range, _words(places), resume)
    try:
        document = work.train(
            files, jobs.Selection(**options), work.Targets(force, place, tuple(position or ())), out,
            settings=settings, tests=test_file or (), overwrite=overwrite, say=_say,
            progress=_Tenths(_say),
        )  # fmt: skip
    except KeyboardInterrupt:
        if (out / work.CHECKPOINT).is_dir():
            given = [word for word in sys.argv[1:] if word not in ("--resume", "--overwrite")]
            _say(f"To go on: hysid {shlex.join([*given, '--resume'])}")
        raise
    _print(document, as_json, _trained_lines(document, out))


@microchannel.command()
def estimate(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of a trained sensor.")],
    file: Annotated[Path, typer.Argument(metavar="FILE", help="CSV file with its channels.")],
    out: Annotated[
        Path | None, typer.Option("--out", help="FILE.csv; DIR/estimated-FILE.csv by default.")
    ] = None,
    where: Where = None,
    na_values: NaValues = "",
    as_json: AsJson = False,
) -> None:
    """Run a trained sensor over a file; where the truth is in it too, say how far off it is."""
    from ._app import _print, _start

    _start()
    from ..soft_sensor import _estimate as work

    document = work.estimate(
        folder, file, out, where=tuple(where or ()), na_values=_words(na_values)
    )
    _print(document, as_json, _estimated_lines(document))


class _Tenths:
    """A line whenever another tenth is done."""

    def __init__(self, say: Any):
        self._say, self._tenth = say, -1

    def __call__(self, done: int, total: int, words: str) -> None:
        tenth = 10 * done // total
        if tenth != self._tenth:
            self._tenth = tenth
            self._say(f"training: {100 * done // total} %, {words}")


def _words(text: str) -> tuple[str, ...]:
    return tuple(part.strip() for part in text.split(",") if part.strip())


def _trained_lines(document: dict[str, Any], out: Path) -> list[str]:
    lines = [f"Mind: {note}" for note in document["notes"]]
    if (force := document["force"]) is not None:
        lines.append(
            f"Force: {force['kind']}; on held-out parts of what it learnt from {force['held_out_rmse']:.3g}"
            f" rms ({force['held_out_nrmse_percent']:.3g} % of the range)"
        )
    for part, said in (("train", "learnt from"), ("test", "held out")):
        if (figures := document["metrics"][part]) is not None:
            rows = document[f"rows_{part}"]
            lines += [f"{said} ({rows} rows):", *(f"  {x}" for x in _figure_lines(figures))]
    return [*lines, f"Sensor: {out}"]


def _figure_lines(figures: dict[str, Any]) -> list[str]:
    from ..soft_sensor._estimate import confusion_lines

    lines = []
    if (force := figures.get("force")) is not None:
        lines.append(f"force: {force['rmse']:.3g} rms, {force['nrmse_percent']:.3g} % of the range")
    if (place := figures.get("place")) is not None:
        lines.append(f"place: {place['accuracy']:.1%} of {place['rows']} rows right")
        lines += [f"  {line}" for line in confusion_lines(place["confusion"])]
        if place["rows_at_rest"]:
            lines.append(
                f"  {place['rest_taken_for_a_place']} of {place['rows_at_rest']} rows without a place"
                " taken for one"
            )
    if (position := figures.get("position")) is not None:
        lines.append(
            f"position: off by {position['mean_error']:.3g} in the mean,"
            f" 95 % within {position['q95_error']:.3g}"
        )
    return lines


def _estimated_lines(document: dict[str, Any]) -> list[str]:
    lines = [f"Mind: {note}" for note in document["notes"]]
    for channel, faults in document["channels_at_fault"].items():
        said = ", ".join(f"{fault} in {n} rows" for fault, n in faults.items())
        lines.append(f"Mind: {channel}: {said}.")
    figures = {k: document[k] for k in ("place", "position") if k in document}
    if document["rmse"] is not None:
        figures["force"] = document
    lines += _figure_lines(figures) or ["nothing measured to compare with"]
    return [*lines, f"{document['flagged']} of {document['rows']} rows flagged", document["file"]]
