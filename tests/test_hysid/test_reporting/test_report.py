"""The report: complete, self-contained, readable by a parser, and honest about what is missing."""

import base64
import hashlib
import json
import re
import shutil
from collections import Counter
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from benchmarks._identification.cases import constructed_cases, shown
from hysteresis import LinearSponge, Record, read_csv
from identify import fit, load, sample, save, save_posterior
from identify.internal import sealed
from tests.test_hysid.command import SPONGE, F, T, X, run
from tests.thorough import rest_thorough

HEADINGS = ["Loops", "Residuals", "Parameters", "Posterior", "Compensator", "Candidates", "Data"]
VOID = {"meta", "img", "br", "hr", "link", "input"}


class Page(HTMLParser):
    """What a page holds; complains about tags that do not close in order."""

    def __init__(self, file: Path):
        super().__init__()
        self.html = file.read_text("utf-8")
        self.open, self.tags, self.said = [], [], []
        self.feed(self.html)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] not in ("style", "script"):
            self.said.append(data)

    @property
    def text(self) -> str:
        return " ".join(" ".join(self.said).split())

    @property
    def live(self) -> list[dict]:
        """What is drawn again where scripts run."""
        found = re.findall(r'<script type="application/json">(.*?)</script>', self.html)
        return [json.loads(one) for one in found]

    def all(self, tag: str) -> list[dict]:
        return [attributes for name, attributes in self.tags if name == tag]

    def headings(self) -> list[str]:
        return re.findall(r'<h2 id="[a-z]+">([A-Za-z]+)</h2>', self.html)


def write_report(folder: Path) -> Path:
    done = run("report", folder)
    assert done.code == 0, done.err
    return folder / "report.html"


def sponge() -> Record:
    return read_csv(SPONGE, input=F, output=X, time=T)


@pytest.fixture(scope="module")
def preisach(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return save(fit(sponge(), "Preisach", test_cycles=1), tmp_path_factory.mktemp("preisach"))


@pytest.fixture(scope="module")
def line(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Nothing held out, a fixed parameter; four starts and the one the record suggests."""
    start = LinearSponge(K=1.0, b=0.0, threshold=1.5)
    found = fit(sponge(), start, starts=4, noise="gaussian")
    return save(found, tmp_path_factory.mktemp("line"))


TRIP = 40
"""Rows of a record that is not long to the command."""


@pytest.fixture(scope="module")
def page(preisach: Path) -> Page:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("hysid.reporting._case.TRIP", TRIP)
        return Page(write_report(preisach))


def test_a_report_stands_alone(preisach: Path, page: Page):
    file = preisach / "report.html"
    assert file.stat().st_size < 2_000_000
    # The sums of a grid's weights are folded, below what the specimen does.
    assert page.headings() == [*HEADINGS[:2], "Posterior", "Density", *HEADINGS[4:]]
    for said in ("stiffness", "loop width", "energy lost", "the input is never held"):
        assert said in page.text.split("Loops")[0]
    assert "<summary>Show its parts</summary>" in page.html
    # One script, which the rules of the page name, and the numbers that it draws.
    rules = next(meta["content"] for meta in page.all("meta") if "http-equiv" in meta)
    (script,) = re.findall(r'<script type="module">(.*?)</script>', page.html, re.DOTALL)
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    assert f"img-src data:; script-src 'sha256-{digest}';" in rules
    kinds = Counter(attributes["type"] for attributes in page.all("script"))
    assert kinds == {"module": 1, "application/json": len(page.live)}
    assert len(page.live) >= 5
    for picture in page.live:
        assert {"x", "y", "curves", "limits", "logarithmic"} == set(picture)
    assert not page.all("link")
    own = page.html.replace(script, "")
    assert "://" not in own
    assert "url(" not in own
    assert all(a["href"].startswith("#") for a in page.all("a"))
    assert all(a["src"].startswith("data:image/png;base64,") for a in page.all("img"))
    assert all(a["alt"].strip() for a in page.all("img"))
    assert len(page.all("img")) >= 10
    ids = {attributes["id"] for _, attributes in page.tags if "id" in attributes}
    assert {a["href"][1:] for a in page.all("a")} <= ids


def test_it_says_what_a_rig_engineer_asks(preisach: Path, page: Page):
    assert "PASS" in page.text
    for reason in json.loads((preisach / "fit.json").read_text())["verdict"]["reasons"]:
        assert reason["text"] in page.text
    assert re.search(r"held-out error, rms 0\.0\d+ mm", page.text)
    assert f"hysid sample {preisach}" in page.text  # what to do next
    assert re.search(r"estimates the force with an error of [0-9.]+ N rms", page.text)
    assert "of its range: exact." in page.text
    assert "210 weights" in page.text  # summed up, and says so
    assert "No starts were needed." in page.text
    assert json.loads((preisach / "fit.json").read_text())["data"]["sha256"] in page.text


@pytest.mark.thorough
def test_without_a_test_part_and_with_a_posterior(line: Path):
    save_posterior(sample(load(line), steps=200, ensembles=2), line)
    page = Page(write_report(line))
    assert page.headings() == HEADINGS
    assert "Nothing was held out" in page.text
    assert "--test-cycles 1" in page.text
    assert re.search(r"band holds \d+ % of \d+ training rows, which count as", page.text)
    assert re.search(r"\d of 5 starts reach the least error, within 1 %", page.text)
    assert "R-hat" in page.text
    row = re.search(r"<tr>\s*<th scope=\"row\">threshold</th>.*?</tr>", page.html, re.DOTALL)
    assert re.findall(r"<td.*?>(.*?)</td>", row.group()) == [
        "1.50", "N", "", "fixed", "fixed",
    ]  # fmt: skip
    assert "From cycle to cycle" in page.text


def test_colours_are_readable_by_day_and_by_night(page: Page):
    """WCAG's least contrast of text, 4.5, on paper, in code and in the boxes of every verdict."""
    style = page.html.split("<style>")[1].split("</style>")[0]
    assert '<meta name="color-scheme" content="light dark">' in page.html
    night = style.index("@media screen and (prefers-color-scheme: dark)")  # print stays light
    for words in (style[:night], style[night:]):
        tones = dict(re.findall(r"--(ink|soft|paper|wash|link): (#[0-9a-f]{3,6})", words))
        assert len(tones) == 5
        tints = re.findall(r"--tint: (#[0-9a-f]{6})", words)
        assert len(tints) == 3
        for back in (tones["paper"], tones["wash"], *tints):
            for ink in ("ink", "soft", "link"):
                assert contrast(tones[ink], back) >= 4.5
    for badge in re.findall(r"--tone: (#[0-9a-f]{6})", style):
        assert contrast("#fff", badge) >= 4.5


def contrast(one: str, other: str) -> float:
    """Of two colours, as WCAG 2 defines it."""
    bright, dark = sorted(map(luminance, (one, other)), reverse=True)
    return (bright + 0.05) / (dark + 0.05)


def luminance(colour: str) -> float:
    digits = colour[1:] if len(colour) == 7 else "".join(2 * c for c in colour[1:])
    parts = [int(digits[k : k + 2], 16) / 255 for k in (0, 2, 4)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def test_a_density_of_an_output_that_falls_and_errors_that_are_weighed(tmp_path: Path):
    record = sponge()
    far = record.input > np.quantile(record.input, 0.8)
    columns = {**record.columns, "s": np.where(record.input > 10, 3.0, 1.0)}
    record = replace(record, output=-record.output, columns=columns, sigma_name="s")
    train, test = record.split_rows(far)
    found = fit(train, "Preisach", test=test)
    page = Page(write_report(save(found, tmp_path / "falls")))
    assert "The displacement falls where a relay switches up." in page.text
    rms = f"{found.metrics['train'].rmse:#.3g} mm"
    for words in ("Over the fitted rows they are", "Training rows, rms error"):
        assert f"{words} {rms}" in page.text
    assert "of its range: exact." in page.text  # beyond the trained inputs, too


def test_a_folder_at_fault_is_named(tmp_path: Path, preisach: Path):
    assert "[file-not-found]" in run("report", tmp_path).err
    broken = shutil.copytree(preisach, tmp_path / "broken")
    document = json.loads((broken / "fit.json").read_text())
    del document["structure"]
    (broken / "fit.json").write_text(json.dumps(sealed(document)))
    assert "[damaged-file]" in run("report", broken).err
    (broken / "fit.json").write_text(json.dumps({"schema": 1, "each": {"a": {}, "b": {}}}))
    assert "a, b. [several-fits]" in run("report", broken).err


def test_an_overview_links_to_every_report(preisach: Path, line: Path, tmp_path: Path):
    for value, source in {"a b": preisach, "<c>": line}.items():
        shutil.copytree(source, tmp_path / value)
        (tmp_path / value / "report.html").touch()
    done = run("report", tmp_path / "a b", tmp_path / "<c>", "--json").json()
    page = Page(Path(done["file"]))
    away = [a["href"] for a in page.all("a") if not a["href"].startswith("#")]
    assert set(away) == {"a%20b/report.html", "%3Cc%3E/report.html"}
    assert "1 PASS" in page.text
    assert "LinearSponge" in page.text
    assert Path(done["file"]).stat().st_size < 150_000
    assert "[file-not-found]" in run("report", tmp_path / "gone").err


def test_of_a_long_record_some_rows_are_sent_through_the_compensator(preisach: Path, page: Page):
    """Those that count, after half as many that come before."""
    test, half = load(preisach).test, TRIP // 2
    first = int(np.argmax(test.mask))
    held = test.mask[first : first + half].sum()
    assert f"uses rows {first - half:,} to {first + half - 1:,} of {len(test):,}." in page.text
    assert f"From the measured displacement of {held} held-out rows" in page.text


@pytest.mark.parametrize(
    "case", rest_thorough(constructed_cases(), lambda case: case.name == "at bound")
)
def test_what_cannot_be_believed_is_shown_everywhere(case, tmp_path: Path) -> None:
    assert all(shown(case, tmp_path))
