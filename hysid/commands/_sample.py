"""`hysid sample`: the posterior of a fit, or of each of several."""

from typing import Any

import identify
from hysteresis._escape import shell_word
from identify import save_posterior

from ..intake._folders import folders_of
from ._asked import Sample
from ._console import Done, Progress, log, warnings


def run(asked: Sample) -> Done:
    """Sample the posterior of a fit, or of each of several, and keep it beside; as `identify.sample`."""
    chosen = {name: getattr(asked, name) for name in ("steps", "walkers", "ensembles", "seed")}
    try:
        with Progress("sampling") as progress:
            found = _sampled(asked, chosen, progress)
    except KeyboardInterrupt:
        given = [f"--{name} {value}" for name, value in chosen.items() if value is not None]
        log(f"To resume: hysid sample {shell_word(str(asked.folder))} --resume {' '.join(given)}")
        raise
    lines = [f"{'parameter':24}{'mean':>12}{'sd':>12}{'5 %':>12}{'95 %':>12}{'R-hat':>8}{'ESS':>8}"]
    lines += [
        f"{p['name']:24}{p['mean']:12.4g}{p['sd']:12.3g}{p['q05']:12.4g}{p['q95']:12.4g}"
        f"{p['rhat']:8.3f}{p['ess']:8.0f}{''.join(f'  {words}' for words in p['words'])}"
        for p in found["parameters"]
    ]
    lines += warnings(found["notes"])
    if not found["converged"]:
        lines.append(
            "Not converged: R-hat is above 1.01, or there are too few draws. Run again without"
            " --steps, or with more of them."
        )
    return Done(found, lines)


def _sampled(asked: Sample, chosen: dict[str, Any], progress: Progress) -> dict[str, Any]:
    folders = folders_of(asked.folder, identify.internal.read_document(asked.folder))
    documents = {}
    for value, name in folders.items():
        place = asked.folder / name

        def named(done: int, total: int, text: str, value: str = value) -> None:
            progress(done, total, f"{value}, {text}" if value else text)

        posterior = identify.sample(
            identify.load(place), checkpoint=place / "chains.npz", progress=named,
            resume=asked.resume, **chosen,
        )  # fmt: skip
        save_posterior(posterior, place)
        documents[value] = identify.internal.posterior_json(posterior)
    if "" in documents:
        return documents[""]
    parameters = [
        p | {"name": f"{value}: {p['name']}"}
        for value, d in documents.items()
        for p in d["parameters"]
    ]
    return {
        "parameters": parameters,
        "draws": sum(d["draws"] for d in documents.values()),
        "seconds": round(sum(d["seconds"] for d in documents.values()), 3),
        "converged": all(d["converged"] for d in documents.values()),
        "notes": [f"{value}: {note}" for value, d in documents.items() for note in d["notes"]],
        "each": documents,
    }
