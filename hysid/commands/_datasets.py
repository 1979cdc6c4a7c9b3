"""`hysid datasets`."""

from hysteresis._escape import shell_word

from .._catalogue import NOT_STATED, catalogue, find
from .._catalogue import fetch as fetched
from ._asked_more import Fetch, List
from ._console import Done, log, warnings


def listed(asked: List) -> Done:
    """A line for each data set."""
    found = catalogue(asked.catalogue)
    lines = [f"{'name':25}{'size':>9}  {'licence':14}what"]
    lines += [
        f"{d.name:25}{d.bytes / 1e6:6.2f} MB  {d.licence or NOT_STATED:14}{d.what}"
        f"{'' if d.checked else ' *'}"
        for d in found
    ]
    if not all(d.checked for d in found):
        lines.append("* Not all checksums are known. To fetch: hysid datasets fetch NAME --accept")
    same = ("name", "what", "bytes", "checked", "page", "citation", "notes")
    told = [
        {name: getattr(d, name) for name in same}
        | {"licence": d.licence or None, "files": len(d.files)}
        for d in found
    ]
    return Done({"datasets": told}, lines)


def fetch(asked: Fetch) -> Done:
    """A data set as a file with its configuration."""
    dataset, out = find(asked.name, asked.catalogue), asked.out
    found = fetched(dataset, out, accept=asked.accept, overwrite=asked.overwrite, say=log)
    if not dataset.licence:
        log("Warning: The source states no licence. Ask its owners before you share the data.")
    for line in warnings(found["notes"]):
        log(line)
    files = (found["file"], found["config"], out / asked.name)
    table, config, fit = (shell_word(str(p)) for p in files)
    lines = [f"{found['rows']} rows: {found['file']}", f"Please cite: {found['citation']}"]
    return Done(found, [*lines, f"Next: hysid fit {table} --config {config} --out {fit}"])
