"""`hysid demo`: a synthetic sponge record from its file to a report."""

from pathlib import Path

import identify
from hysteresis._files import write_whole
from hysteresis.rigs._foam_block import FoamBlock

from ..reporting._report import write_report
from ._asked import Demo, Fit, Predict, Sample
from ._console import Done, log, print_result, verdict_lines

DATASETS = Path(__file__).resolve().parents[2] / "datasets"


def run(asked: Demo) -> Done:
    """The whole road on a synthetic sponge record: fit, posterior, compensator, report."""
    out = asked.out
    file = demo_data(out)
    if (out / "fit.json").exists():
        before = identify.internal.read_document(out).get("data", {}).get("source", "")
        identify.internal.check_free(out, overwrite=Path(before).name == file.name)
    log(
        f"fitting {file.name}: a synthetic sponge pressed in 13 cycles, of which no two have the same "
        "peak, rate and rest; the last three are held out"
    )
    selection = {
        "input": "force (N)", "output": "displacement (mm)", "time": "time (s)",
        "test_where": ("cycle=11,12,13",),
    }  # fmt: skip
    document = Fit(file=file, selection=selection, out=out, overwrite=True).run().document
    if not asked.as_json:  # the verdict needs none of what follows
        print_result(document, False, verdict_lines(document))
    log("sampling the posterior")
    Sample(folder=out, steps=1000, ensembles=2).run()
    log("running the compensator: displacement in, force out")
    backwards = Predict(folder=out, file=file, inverse=True).run().document
    log("writing the report")
    report = str(write_report(out))
    lines = [
        f"Compensator, displacement -> force, over all rows: {backwards['rmse']:.3g} N rms"
        f" ({backwards['nrmse_percent']:.2g} % of the range), {backwards['flagged']} flagged.",
        *backwards["notes"],
        f"Report: {report}",
    ]
    return Done(document | {"inverse": backwards, "report": report}, lines)


def demo_data(out: Path, datasets: Path = DATASETS) -> Path:
    """The shipped record; where the package was installed without it, the rig makes it anew."""
    name = "sponge-50mm-mixed-cycles.csv"
    shipped = datasets / name
    if shipped.is_file():
        return shipped
    file = out / name
    rows = zip(*FoamBlock().mixed_cycles(noise=0.05, seed=52), strict=True)
    lines = [f"{t:.1f},{F:.3f},{round(float(d), 3) + 0.0:.3f},{n}\n" for t, F, d, n in rows]
    write_whole(file, "time (s),force (N),displacement (mm),cycle\n" + "".join(lines))
    return file
