"""Pages and pictures about columns that may be called anything."""

from html.parser import HTMLParser
from pathlib import Path

import numpy as np

import hysid
import identify
from hysteresis import Record
from tests.test_hysteresis.test_escape import HOSTILE


class Tags(HTMLParser):
    """The tags of a page with the names of their attributes."""

    def __init__(self, page: str):
        super().__init__()
        self.tags: set[tuple[str, ...]] = set()
        self.feed(page)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.add((tag, *(name for name, _ in attrs)))


def fitted(input: str, output: str) -> identify.FitResult:
    u = np.tile(np.concatenate([np.linspace(0, 5, 20), np.linspace(5, 0, 20)]), 3)
    y = 0.5 * u + 0.01 * np.random.default_rng(0).standard_normal(u.size)
    record = Record.from_arrays(u, y, input_name=input, output_name=output, source=input)
    return identify.fit(record, "LinearSponge", noise="gaussian", starts=1)


def test_names_are_text_on_every_page(tmp_path: Path):
    """A report has the kinds of tags that it has of innocent names, and so has a notebook's page."""
    pages = []
    names = [("force (N)", "x (mm)"), ("".join(HOSTILE), "".join(HOSTILE[::-1]))]
    for k, (a, b) in enumerate(names):
        fit = fitted(a, b)
        page = hysid.report(fit, tmp_path / f"{k}.html").read_bytes().decode("utf-8")
        pages.append([Tags(page), Tags(fit._repr_html_()), Tags(fit.train._repr_html_())])
        assert "&lt;U+202E&gt;" in page or not k
        assert not set("\0\u202e\u2066\x1b") & set(page)
    for innocent, hostile in zip(*pages, strict=True):
        assert hostile.tags == innocent.tags
