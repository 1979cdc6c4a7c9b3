r"""Equations as SVG within the page: typeset when it is built, legible in either theme, without a network.

Matplotlib's mathtext draws them, so TeX is limited to what that knows: no environments. In a displayed
equation `\\` begins a line and `&` aligns it with the others.
"""

from html import escape
from typing import Any

from docutils import nodes
from matplotlib.font_manager import FontProperties
from matplotlib.path import Path
from matplotlib.textpath import TextPath, TextToPath

FONT = FontProperties(math_fontfamily="stix", size=10.0)
CODES = {
    Path.MOVETO: "M",
    Path.LINETO: "L",
    Path.CURVE3: "Q",
    Path.CURVE4: "C",
    Path.CLOSEPOLY: "Z",
}


def svg(tex: str) -> str:
    """TeX as an image in the colour of the text around it, standing on its baseline.

    Raises `ValueError` where mathtext cannot read it.
    """
    tex = " ".join(tex.split())
    text = f"${tex}$"
    width, height, depth = TextToPath().get_text_width_height_descent(text, FONT, ismath=True)
    drawn = []
    for points, code in TextPath((0, 0), text, prop=FONT).iter_segments(
        curves=True, simplify=False
    ):
        pairs = [] if code == Path.CLOSEPOLY else [f"{x:.2f}" for x in points]
        drawn.append(CODES[code] + " ".join(pairs))
    em = FONT.get_size_in_points()
    size = f"width: {width / em:.3f}em; height: {height / em:.3f}em"
    return (
        f'<svg class="math" role="img" aria-label="{escape(tex)}" '
        f'style="{size}; vertical-align: {-depth / em:.3f}em" '
        f'viewBox="0 {depth - height:.2f} {width:.2f} {height:.2f}">'
        f'<path transform="scale(1 -1)" fill="currentColor" d="{"".join(drawn)}"/></svg>'
    )


def displayed(tex: str) -> str:
    """An equation of its own: a row for each line, the parts before and after `&` aligned."""
    rows = []
    for line in tex.strip().split(r"\\"):
        left, aligned, right = line.partition("&")
        cells = [left, right] if aligned else [line]
        shown = [svg(cell) if cell.strip() else "" for cell in cells]
        spans = "".join(f"<td>{cell}</td>" for cell in shown)
        rows.append(f"<tr>{spans}</tr>" if aligned else f'<tr><td colspan="2">{shown[0]}</td></tr>')
    return f'<div class="math"><table>{"".join(rows)}</table></div>\n'


def _inline(page: Any, node: Any) -> None:
    page.body.append(svg(node.astext()))
    raise nodes.SkipNode


def _block(page: Any, node: Any) -> None:
    page.body.append(displayed(node.astext()))
    raise nodes.SkipNode


def setup(app: Any) -> dict[str, bool]:
    """For Sphinx: the renderer named in conf.py."""
    app.add_html_math_renderer("mathtext", (_inline, None), (_block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
