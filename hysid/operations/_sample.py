"""`hysid sample`: the posterior of a fit, or of each of several."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import identify

from ..intake._folders import folders_of


def sample(
    folder: Path,
    *,
    progress: Callable[[int, int, str], None] | None = None,
    **options: Any,
) -> dict[str, Any]:
    """Sample the posterior of a fit, or of each of several, and keep it beside; as `identify.sample`."""
    folders = folders_of(folder, identify.internal.read_document(folder))
    documents = {}
    for value, name in folders.items():
        place = folder / name

        def named(done: int, total: int, text: str, value: str = value) -> None:
            if progress is not None:
                progress(done, total, f"{value}, {text}" if value else text)

        posterior = identify.sample(
            identify.load(place), checkpoint=place / "chains.h5", progress=named, **options
        )
        identify.save_posterior(posterior, place)
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
