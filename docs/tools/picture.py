"""The first picture of the README and of the documentation: a loop, its fit, its compensation, the verdict.

    make picture

writes `docs/_static/hysid-light.svg` and `hysid-dark.svg`. The two files are kept in the repository because
the README shows them. Everything in them is computed from a shipped data set, and a test draws them again.
"""

from pathlib import Path
from typing import Any, NamedTuple

import matplotlib
import numpy as np
from matplotlib.figure import Figure

import hysid
from compensate import qualify
from compensate._qualification import Qualification
from hysid.figures._base import styled

ROOT = Path(__file__).resolve().parents[2]
FILES = {theme: ROOT / "docs" / "_static" / f"hysid-{theme}.svg" for theme in ("light", "dark")}
COLOURS = {
    "light": {"ink": "#1f2328", "faint": "#8c8c8c", "grid": "#e6e6e6", "line": "#D55E00", "ours": "#0072B2",
              "PASS": "#1a7f37", "CAUTION": "#9a6700", "FAIL": "#cf222e"},
    "dark": {"ink": "#e6edf3", "faint": "#8b949e", "grid": "#30363d", "line": "#E69F00", "ours": "#56B4E9",
             "PASS": "#3fb950", "CAUTION": "#d29922", "FAIL": "#f85149"},
}  # fmt: skip
"""The ground is the page's own, so every colour is legible on it."""


class Shown(NamedTuple):
    """What the picture shows, in N and mm; `force`, `line` and `estimate` are of the held-out cycle."""

    measured: tuple[np.ndarray, np.ndarray]
    fitted: tuple[np.ndarray, np.ndarray]
    force: np.ndarray
    line: np.ndarray
    estimate: np.ndarray
    verdict: Qualification


def computed() -> Shown:
    """Fit a Preisach model to four of five presses, invert it, and judge the inverse on the fifth."""
    record = hysid.read_csv(
        ROOT / "datasets" / "sponge-50mm-cycles.csv",
        input="force (N)",
        output="displacement (mm)",
        time="time (s)",
    )
    fit = hysid.fit(record, "Preisach", test_cycles=1)
    train, test = fit.train, fit.test
    assert test is not None
    compensator = hysid.invert(fit.model)
    rows = test.mask
    line = np.polynomial.Polynomial.fit(train.output[train.mask], train.input[train.mask], 1)
    return Shown(
        (record.input, record.output),
        (test.input[rows], np.asarray(fit.predict(test))[rows]),
        test.input[rows],
        line(test.output[rows]),
        np.asarray(compensator.simulate(test.time, test.output).value)[rows],
        qualify(compensator, test, model=fit.model, max_error=2.0),
    )


@styled
def draw(shown: Shown, theme: str, file: Path) -> None:
    """Write the picture in one theme as an SVG with a transparent ground."""
    colour, verdict = COLOURS[theme], shown.verdict
    settings: Any = matplotlib.rcParams
    settings.update({"svg.hashsalt": "hysid", "svg.fonttype": "none", "grid.color": colour["grid"]})
    settings.update({"font.size": 11, "axes.titlesize": 12, "legend.fontsize": 10.5})
    settings |= dict.fromkeys(("axes.edgecolor", "xtick.color", "ytick.color"), colour["faint"])
    settings |= dict.fromkeys(("axes.labelcolor", "text.color", "axes.titlecolor"), colour["ink"])
    figure = Figure(figsize=(9.2, 4.1), layout="constrained")
    left, right = figure.subplots(1, 2)
    left.plot(
        *shown.measured, "o", ms=4, mew=0, color=colour["faint"], label="measured", gid="measured"
    )
    left.plot(*shown.fitted, lw=2, color=colour["ours"], label="Preisach model", gid="fitted")
    left.set(xlabel="force (N)", ylabel="displacement (mm)", title="A sponge remembers")
    right.plot(shown.force, shown.line, "o-", ms=3, lw=1.6, color=colour["line"],
               label="straight line", gid="line")  # fmt: skip
    right.plot(shown.force, shown.estimate, "o-", ms=3, lw=2, color=colour["ours"],
               label="compensator", gid="estimate")  # fmt: skip
    right.set(
        xlabel="true force (N)",
        ylabel="estimated force (N)",
        title="Its inverse gives the force back",
    )
    for axes in (left, right):
        axes.set_xticks(range(0, 21, 5))
        axes.legend(loc="upper left", labelcolor=colour["ink"])
    right.set_yticks(range(0, 21, 5))
    figure.supxlabel(
        f"{verdict.level}: held-out cycle, {verdict.errors.rmse:.2f} N rms, "
        f"{100 * verdict.loop.ratio:.0f} % of the loop's width left",
        color=colour[verdict.level], fontsize=13, fontweight="bold",
    )  # fmt: skip
    figure.savefig(file, transparent=True, metadata={"Date": None, "Creator": None})


if __name__ == "__main__":
    hysid.enable_x64()
    found = computed()
    for chosen, written in FILES.items():
        draw(found, chosen, written)
