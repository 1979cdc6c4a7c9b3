"""HTML of records, fits, posteriors and compensators in a notebook: a verdict, a table and a picture."""

import base64
import io
import warnings
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from compensate import AbstractCompensator, Status
from hysteresis import InputError, Record, parameters
from hysteresis._escape import markup
from hysteresis.records._excitation import check_identifiable
from identify import FitResult
from identify.posterior._posterior import Posterior
from identify.results._data_sheet import DataSheet

from . import _base as f
from ._data_sheet import draw_sheet, title
from ._format import number, plain_name, pretty, quantity
from ._plot import draw_compensator, draw_fit, draw_record, of_kind, swept

MOST_ROWS, MOST_POINTS = 12, 1200
COLOURS = {"PASS": f.GREEN, "CAUTION": f.ORANGE, "FAIL": f.VERMILLION}


def html(thing: Any) -> str:
    """A record, a fit, a posterior or a compensator as HTML: one `div` that needs nothing else.

    Raises `InputError` `no-picture` for anything else.
    """
    return of_kind(_SHOWN, thing, "has no HTML form")(thing)


def _record(record: Record) -> str:
    rows = [("rows", f"{len(record):,}, of which {int(record.mask.sum()):,} count")]
    rows.append(("sequences", f"{len(record.labels):,}, with {record.n_cycles:,} complete cycles"))
    sides = (("input", record.input, record.input_name, record.input_unit),
             ("output", record.output, record.output_name, record.output_unit))  # fmt: skip
    for role, x, name, unit in sides:
        seen = x[np.isfinite(x)]
        span = f"{number(seen.min())} to {quantity(seen.max(), unit)}" if len(seen) else "empty"
        rows.append((f"{role}: {plain_name(name, unit)}", span))
    if record.time is not None and len(record) > 1:
        step = float(np.median(np.diff(record.time)))
        rows.append(("median step", quantity(step, record.time_unit)))
    try:
        minded = check_identifiable(record)
    except InputError as error:
        minded = [f"Cannot be used: {error}"]
    picture = _image(draw_record(record, MOST_POINTS), "Output against input")
    parts = [*_listed("Warning: ", minded), _table(("", ""), rows), picture]
    return _page(f"Record {record.source or 'of arrays'}", parts)


def _fit(fit: FitResult) -> str:
    badge, reasons = fit.verdict.level, fit.verdict.reasons
    rows = [
        (p.name, number(p.value, p.stderr), "" if p.stderr is None else f"± {number(p.stderr)}",
         pretty(p.unit), p.status)
        for p in fit.parameters
    ]  # fmt: skip
    errors = [
        (part, quantity(m.rmse, fit.train.output_unit), f"{number(m.nrmse_percent)} %",
         f"{m.r2:.4f}")
        for part, m in fit.metrics.items() if m is not None
    ]  # fmt: skip
    parts = [
        *_listed("", reasons),
        _table(("parameter", "value", "error", "unit", "status"), rows),
        _table(("rows", "rms error", "of the range", "R²"), errors),
        _image(draw_fit(fit, MOST_POINTS), f"Measured loops, and the {fit.name} model"),
    ]
    return _page(fit.name, parts, badge)


def _posterior(posterior: Posterior) -> str:
    ensembles, draws, count = posterior.draws.shape
    said = [f"{ensembles * draws:,} draws by {posterior.method}", *posterior.notes]
    rows = [
        (s.name, *map(number, (s.mean, s.sd, s.q05, s.q95)), f"{s.rhat:.3f}", f"{s.ess:,.0f}",
         ", ".join(s.words))
        for s in posterior.summaries
    ]  # fmt: skip
    shown = min(count, 6)
    figure = Figure(figsize=(1.5 * shown, 1.5), layout="constrained")
    _histograms(figure, posterior, shown)
    table = _table(("parameter", "mean", "sd", "5 %", "95 %", "R-hat", "ESS", ""), rows)
    parts = [*_listed("", said), table, _image(figure, "Histograms of the draws")]
    badge = ("PASS", "converged") if posterior.converged else ("CAUTION", "not converged")
    return _page("Posterior", parts, *badge)


@f.styled
def _histograms(figure: Figure, posterior: Posterior, shown: int) -> None:
    grid, draws = figure.subplots(1, shown, squeeze=False), np.moveaxis(posterior.draws, -1, 0)
    for axes, name, x in zip(grid[0], posterior.names, draws, strict=False):
        axes.hist(x.ravel(), 40, color=f.SKY)
        axes.set(yticks=[], title=name if len(name) < 16 else f"{name[:15]}…")
        axes.grid(False)
        axes.locator_params(axis="x", nbins=2)


def _compensator(compensator: AbstractCompensator) -> str:
    rows = []
    for name, info, value in parameters(compensator):
        if value is None:
            continue
        x = np.asarray(value)
        text = number(float(x.mean()))
        text = f"{x.size:,} numbers, mean {text}" if x.ndim else text
        rows.append((name, text, pretty(info.unit), info.meaning))
    y, _, status = swept(compensator)
    held = [Status(int(s)).name for s in np.unique(status) if s != Status.OK]
    ends = f"from {number(y.min())} to {number(y.max())}"
    said = [f"The readings rise {ends}, fall back and rise half way again."]
    said += [f"Some estimates have the status {', '.join(held)}."] if held else []
    picture = _image(draw_compensator(compensator), "Estimates of the input against readings")
    table = _table(("parameter", "value", "unit", "meaning"), rows)
    return _page(type(compensator).__name__, [*_listed("", said), table, picture])


def _sheet(sheet: DataSheet) -> str:
    return _page(title(sheet), [_image(draw_sheet(sheet), title(sheet))])


_SHOWN: dict[type, Any] = {
    Record: _record, FitResult: _fit, Posterior: _posterior, AbstractCompensator: _compensator,
    DataSheet: _sheet,
}  # fmt: skip


def _page(title: str, parts: Iterable[str], level: str = "", word: str = "") -> str:
    badge = ""
    if level:
        style = f"background:{COLOURS[level]};color:#fff;padding:0 0.5em;border-radius:0.6em"
        badge = f' <span style="{style}">{markup(word or level)}</span>'
    head = f"<p><strong>{markup(title)}</strong>{badge}</p>"
    return f'<div class="hysid">{head}{"".join(parts)}</div>'


def _listed(before: str, sentences: Sequence[str]) -> list[str]:
    if not sentences:
        return []
    items = "".join(f"<li>{markup(before + sentence)}</li>" for sentence in sentences)
    return [f"<ul>{items}</ul>"]


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    def row(kind: str, cells: Sequence[str]) -> str:
        filled = "".join(f"<{kind}>{markup(cell)}</{kind}>" for cell in cells)
        return f"<tr>{filled}</tr>"

    if not rows:
        return ""
    shown = [row("td", cells) for cells in rows[:MOST_ROWS]]
    if len(rows) > MOST_ROWS:
        more = f"and {len(rows) - MOST_ROWS:,} more"
        shown.append(f'<tr><td colspan="{len(head)}">{more}</td></tr>')
    top = f"<thead>{row('th', head)}</thead>" if any(head) else ""
    return f"<table>{top}<tbody>{''.join(shown)}</tbody></table>"


def _image(figure: Figure, alt: str) -> str:
    """As an image of its own: names inside one drawing cannot clash with those of another."""
    text = base64.b64encode(svg(figure)).decode()
    return f'<img alt="{markup(alt)}" src="data:image/svg+xml;base64,{text}"/>'


@f.styled
def svg(figure: Figure) -> bytes:
    """A figure as SVG, the same bytes for the same figure."""
    import matplotlib

    page = io.BytesIO()
    named: Any = {"svg.fonttype": "none", "svg.hashsalt": "hysid"}
    with matplotlib.rc_context(named), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph")  # of a column's name: the browser has it
        figure.savefig(page, format="svg", metadata={"Date": None})
    return page.getvalue()
