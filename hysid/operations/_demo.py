"""`hysid demo`: a synthetic sponge record from its file to a report."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import identify
from hysteresis._atomic_file import write_whole
from hysteresis.rigs import FoamBlock

from ..intake._selection import Selection
from ..reporting._fit_page import write_report
from ._fit import fit
from ._predict import predict
from ._sample import sample

DATASETS = Path(__file__).resolve().parents[2] / "datasets"


def demo(
    out: Path,
    say: Callable[[str], None],
    progress: Callable[[int, int, str], None] | None = None,
    fitted: Callable[[dict[str, Any]], None] = lambda document: None,
) -> dict[str, Any]:
    """The whole road on a synthetic sponge record: fit, posterior, compensator, report.

    `fitted` is called with the fit's document, whose verdict needs none of what follows.
    """
    file = demo_data(out)
    selection = Selection(
        input="force (N)", output="displacement (mm)", time="time (s)",
        test_where=("cycle=11,12,13",),
    )  # fmt: skip
    if (out / "fit.json").exists():
        before = identify.internal.read_document(out).get("data", {}).get("source", "")
        identify.internal.check_free(out, overwrite=Path(before).name == file.name)
    say(
        f"fitting {file.name}: a synthetic sponge pressed in 13 cycles, of which no two have the same "
        "peak, rate and rest; the last three are held out"
    )
    document = fit(file, selection, out, overwrite=True, say=say)
    fitted(document)
    say("sampling the posterior")
    sample(out, steps=1000, ensembles=2, seed=0, resume=False, progress=progress)
    say("running the compensator: displacement in, force out")
    backwards = predict(out, file, inverse=True)
    say("writing the report")
    return document | {"inverse": backwards, "report": str(write_report(out))}


def demo_data(out: Path, datasets: Path = DATASETS) -> Path:
    """The shipped record; where the package was installed without it, the rig makes it anew."""
    name = "sponge-50mm-mixed-cycles.csv"
    shipped = datasets / name
    if shipped.is_file():
        return shipped
    out.mkdir(parents=True, exist_ok=True)
    file = out / name
    rows = zip(*FoamBlock().mixed_cycles(noise=0.05, seed=52), strict=True)
    lines = [f"{t:.1f},{F:.3f},{round(float(d), 3) + 0.0:.3f},{n}\n" for t, F, d, n in rows]
    write_whole(file, "time (s),force (N),displacement (mm),cycle\n" + "".join(lines))
    return file
