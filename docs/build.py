"""The pages of docs/ as HTML, with the figures their code draws.

python docs/build.py [--out out/docs] [PAGE ...]

Every block of Python in a page is run, in order and in one namespace; a `Figure` that its last line
leaves is drawn below it. So what a page says about the code is what the code does.
"""

import argparse
import ast
import io
import sys
from pathlib import Path
from typing import Any

import jax
from markdown_it import MarkdownIt
from matplotlib.figure import Figure

PAGE = """<!doctype html><html lang="en"><meta charset="utf-8">
<meta name="viewport" content="width=device-width"><title>{title}</title><style>
body {{ max-width: 46rem; margin: 2rem auto; padding: 0 1rem; font: 16px/1.55 sans-serif; color: #222 }}
pre {{ background: #f6f6f6; padding: .8rem; overflow-x: auto; font-size: 13px }}
table {{ border-collapse: collapse }} td, th {{ border-bottom: 1px solid #ddd; padding: .3rem .8rem }}
figure {{ margin: 1rem 0 }} svg {{ max-width: 100%; height: auto }}
.math {{ overflow-x: auto; font-family: serif; font-style: italic; white-space: pre-wrap }}
</style><body>{body}</body></html>
"""


def build(page: Path) -> str:
    """A page as HTML, its code run."""
    markdown = MarkdownIt("commonmark", {"html": False}).enable("table")
    tokens = markdown.parse(page.read_text("utf-8"))
    names: dict[str, Any] = {}
    parts, done = [], 0
    for k, token in enumerate(tokens):
        if token.type == "fence" and token.info == "python":
            parts.append(markdown.renderer.render(tokens[done : k + 1], markdown.options, {}))
            done = k + 1
            left = run(token.content, names, f"{page.name}:{(token.map or [0])[0] + 1}")
            if isinstance(left, Figure):
                parts.append(f"<figure>{svg(left)}</figure>")
    parts.append(markdown.renderer.render(tokens[done:], markdown.options, {}))
    title = next((t.content for t in tokens if t.type == "inline"), page.stem)
    return PAGE.format(title=title, body="".join(parts))


def run(code: str, names: dict[str, Any], place: str) -> Any:
    """Run a block; the value of its last line, where that is an expression."""
    tree = ast.parse(code, place)
    last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
    exec(compile(tree, place, "exec"), names)
    return None if last is None else eval(compile(ast.Expression(last.value), place, "eval"), names)


def svg(figure: Figure) -> str:
    """A figure as an SVG element."""
    file = io.StringIO()
    figure.savefig(file, format="svg", bbox_inches="tight")
    text = file.getvalue()
    return text[text.index("<svg") :]


def main() -> int:
    """Build the pages named, or all of them."""
    here = Path(__file__).parent
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("pages", nargs="*", type=Path, default=sorted(here.glob("*.md")))
    parser.add_argument("--out", type=Path, default=Path("out/docs"))
    chosen = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    chosen.out.mkdir(parents=True, exist_ok=True)
    for page in chosen.pages:
        file = chosen.out / f"{page.stem}.html"
        file.write_text(build(page), "utf-8")
        print(file)
    return 0


if __name__ == "__main__":
    sys.exit(main())
