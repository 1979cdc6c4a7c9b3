"""`hysid sample`: the posterior of a fit, or of each of several."""

from typing import Any

import identify
from hysteresis import Note
from hysteresis._escape import shell_word
from identify import save_posterior
from identify.posterior._sample import MOST_STEPS

from ..intake._folders import folders_of
from ._asked import CHAINS, Sample
from ._console import Done, Progress, log


def run(asked: Sample) -> Done:
    """Sample the posterior of a fit, or of each of several, and keep it beside; as `identify.sample`."""
    chosen = {name: getattr(asked, name) for name in ("steps", "walkers", "ensembles", "seed")}
    try:
        with Progress("sampling") as progress:
            drawn = _sampled(asked, chosen, progress)
    except KeyboardInterrupt:
        log(f"To resume: {_resuming(asked, chosen)}")
        raise
    cut_short = any(Note.of(n).code == "interrupted" for one in drawn.values() for n in one.notes)
    documents = {v: identify.internal.posterior_json(one) for v, one in drawn.items()}
    found = documents[""] if "" in documents else _together(documents)
    lines = [f"{value}: {one}" if value else str(one) for value, one in drawn.items()]
    if not found["converged"]:
        twice = 2 * (asked.steps or MOST_STEPS)
        lines.append(
            "Not converged: R-hat is above 1.01, or there are too few draws. To draw more: "
            + _resuming(asked, chosen if cut_short else chosen | {"steps": twice})
        )
    return Done(found, lines)


def _resuming(asked: Sample, chosen: dict[str, Any]) -> str:
    """The command that goes on with these options."""
    given = [f"--{name} {value}" for name, value in chosen.items() if value is not None]
    return f"hysid sample {shell_word(str(asked.folder))} --resume {' '.join(given)}"


def _sampled(
    asked: Sample, chosen: dict[str, Any], progress: Progress
) -> dict[str, identify.internal.Posterior]:
    folders = folders_of(asked.folder, identify.internal.read_document(asked.folder))
    free, instead = asked.resume or asked.overwrite, "go on from them (--resume)"
    for name in folders.values():
        identify.internal.check_free(asked.folder / name, free, CHAINS, instead)
    drawn = {}
    for value, name in folders.items():
        place = asked.folder / name

        def named(done: int, total: int, text: str, value: str = value) -> None:
            progress(done, total, f"{value}, {text}" if value else text)

        drawn[value] = identify.sample(
            identify.load(place), checkpoint=place / CHAINS, progress=named,
            resume=asked.resume, **chosen,
        )  # fmt: skip
        save_posterior(drawn[value], place)
    return drawn


def _together(each: dict[str, dict[str, Any]]) -> dict[str, Any]:
    named = [p | {"name": f"{v}: {p['name']}"} for v, d in each.items() for p in d["parameters"]]
    notes = [f"{value}: {note}" for value, d in each.items() for note in d["notes"]]
    draws, seconds, converged = zip(
        *((d["draws"], d["seconds"], d["converged"]) for d in each.values()), strict=True
    )
    return {
        "parameters": named, "draws": sum(draws), "seconds": round(sum(seconds), 3),
        "converged": all(converged), "notes": notes, "each": each,
    }  # fmt: skip
