"""The pages of docs/ run: their code does what their text says."""

import importlib.util
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[1] / "docs"
PAGES = sorted(DOCS.glob("*.md"))


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.stem)
def test_a_page_runs_and_draws(page: Path) -> None:
    spec = importlib.util.spec_from_file_location("docs_build", DOCS / "build.py")
    assert spec is not None
    assert spec.loader is not None
    build = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(build)
    html = build.build(page)
    drawn = html.count("<figure>")
    assert drawn == sum(map(page.read_text("utf-8").count, ("plots.", "\nfigure\n"))) > 0
