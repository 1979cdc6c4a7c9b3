"""The pages of docs/: their code does what their text says, their lists are whole, their links lead on."""

import importlib.util
import inspect
import re
import shlex
import shutil
import sys
import tomllib
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from matplotlib.figure import Figure

from tests.test_hysid.command import run

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGES = sorted(DOCS.rglob("*.md"))
MOST_CODES = 116
"""A new fault has a code already, in most cases."""

DRAWS = re.compile(
    r"^(?:figure$|plots\.|(?!axes|left|right|above|below)[\w.]+(?:\(.*\))?\.plot\()", re.MULTILINE
)
"""The last line of a block that ends with a figure."""


def tool(name: str) -> ModuleType:
    """A module of docs/tools/, which is on no path."""
    if name not in sys.modules:
        spec = importlib.util.spec_from_file_location(name, DOCS / "tools" / f"{name}.py")
        sys.modules[name] = importlib.util.module_from_spec(spec)
        sys.path.insert(0, str(DOCS / "tools"))  # for what it imports from its own folder
        try:
            spec.loader.exec_module(sys.modules[name])
        finally:
            sys.path.pop(0)
    return sys.modules[name]


def python_of(page: Path) -> list:
    found = tool("cells").blocks(page.read_text("utf-8"))
    return [block for block in found if block.kind == "python"]


@pytest.mark.pages
@pytest.mark.parametrize("page", [p for p in PAGES if python_of(p)], ids=lambda p: p.stem)
def test_a_page_runs_and_draws(page: Path) -> None:
    names: dict = {}
    left = [
        tool("cells").run(block.code, names, f"{page.name}:{block.line}")
        for block in python_of(page)
    ]
    drawn = sum(isinstance(value, Figure) for value in left)
    assert drawn == len(DRAWS.findall(page.read_text("utf-8")))
    assert drawn > 0 or page.stem == "targets"


@pytest.mark.pages
def test_the_picture_of_the_readme_is_what_the_code_draws(tmp_path: Path):
    picture = tool("picture")
    shown = picture.computed()
    for theme, kept in picture.FILES.items():
        drawn = tmp_path / kept.name
        picture.draw(shown, theme, drawn)
        words, numbers = zip(*map(_words_and_numbers, (kept, drawn)), strict=True)
        assert words[0] == words[1], "draw it again by `make picture`"
        assert "PASS: held-out cycle" in " ".join(words[0])
        # In points of the page: the fit and the inverse are not the same to the last bit everywhere.
        for name, curve in numbers[0].items():
            np.testing.assert_allclose(numbers[1][name], curve, atol=0.5, err_msg=name)
        assert kept.stat().st_size < 60_000


def _words_and_numbers(file: Path) -> tuple[list[str], dict[str, list[float]]]:
    """The words of an SVG, and the coordinates of its four curves."""
    text = file.read_text("utf-8")
    curves = {}
    for name in ("measured", "fitted", "line", "estimate"):
        drawn = re.search(rf'<g id="{name}">(.*?)^   </g>', text, re.DOTALL | re.MULTILINE)
        path = re.sub(r"<defs>.*?</defs>|#\w+", "", drawn[1], flags=re.DOTALL)
        curves[name] = [float(x) for x in re.findall(r"(?<![\w.])-?\d+\.\d+", path)]
        assert len(curves[name]) >= 40
    return re.findall(r"<text[^>]*>([^<]+)</text>", text), curves


@pytest.mark.pages
def test_the_python_of_the_readme_runs(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(ROOT)
    for block in python_of(ROOT / "README.md"):
        tool("cells").run(block.code, {}, f"README.md:{block.line}")


@pytest.mark.pages
def test_the_readme_shows_what_its_commands_print(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    shutil.copy(ROOT / "datasets" / "sponge-50mm-cycles.csv", tmp_path / "run.csv")
    monkeypatch.chdir(tmp_path)
    shown = (ROOT / "README.md").read_text("utf-8").split("```text\n")[1].split("```")[0]
    commands = re.split(r"^\$ hysid ", shown, flags=re.MULTILINE)[1:]
    assert len(commands) == 3
    for block in commands:
        command, *lines = block.strip().splitlines()
        printed = run(*shlex.split(command)).out.splitlines()
        assert [line for line in lines if line not in (*printed, "  ...", "")] == []


def test_every_public_name_is_documented_once():
    listed = [
        f"{package}.{name}"
        for page in PAGES
        for package, names in tool("cells").NAMES.findall(page.read_text("utf-8"))
        for name in names.split()
    ]
    assert len(listed) == len(set(listed))
    public = set(tool("public").public_names())
    missing, gone = sorted(public - set(listed)), sorted(set(listed) - public)
    assert missing == [], "to be listed in a page of docs/api/"
    assert gone == [], "listed in docs/api/ and no longer there"


@pytest.mark.pages
def test_equations_of_pages_are_typeset():
    displayed, inside = (
        re.compile(r"\$\$(.+?)\$\$", re.DOTALL),
        re.compile(r"(?<!\$)\$([^$\n]+)\$(?!\$)"),
    )
    code = re.compile(r"^```.*?^```$|`[^`]*`|^    [^\n]*$", re.DOTALL | re.MULTILINE)
    texts = [code.sub("", page.read_text("utf-8")) for page in PAGES]
    shown = [found for text in texts for found in displayed.findall(text)]
    shown += [found for text in texts for found in inside.findall(displayed.sub("", text))]
    assert len(shown) > 100
    for tex in shown:  # raises where mathtext cannot read it
        assert tool("mathematics").displayed(tex).count("<svg") >= 1
    made = tool("mathematics").displayed(r"y &= K u\\ \dot z &= \alpha")
    assert made.count("<tr>") == 2
    assert 'aria-label="\\dot z"' in made


@pytest.mark.pages
def test_equations_of_docstrings_are_typeset():
    """What a block says is in its TeX: the same digits, brackets and signs, in the same order."""
    kept = re.compile(r"[^\d()\[\]|/+=]")
    read = unread = 0
    for value in tool("public").public_names().values():
        for found in re.findall(r"(?:^    .*\n?)+", inspect.getdoc(value) or "", re.MULTILINE):
            text = inspect.cleandoc(found)
            tex = tool("equations").tex(text)
            unread += tex is None
            if tex is not None and "sqrt" not in text:
                # Braces and a sign in TeX.
                plain = re.sub(r"[_^]\(([^()]*)\)|[<>]=|\+-(?=\d)", r"\1", text)
                assert kept.sub("", tex) == kept.sub("", plain), text
            if tex is not None:
                tool("mathematics").displayed(tex)
                read += 1
    assert read > 40
    assert tool("equations").tex("y = model.simulate(t, u)") is None
    assert tool("equations").tex("simulate(t, u) == evaluate(prepare(t, u))") is None
    assert tool("equations").tex(">>> x = 1") is None


def test_every_code_of_the_source_is_listed():
    raised = {
        code
        for package in ("hysteresis", "identify", "compensate", "hysid")
        for file in (ROOT / package).rglob("*.py")
        for code in re.findall(r'InputError\(\s*"([\w-]+)"', file.read_text("utf-8"))
    }
    found = tool("error_codes").faults(ROOT)
    assert raised <= {fault.code for fault in found}
    known = {fault.problem for fault in found if fault.code == "conflicting-options"}
    assert "Give --time COL or --dt SECONDS, not both." in known
    assert all(line.count(" | ") == 3 for line in tool("error_codes").table(ROOT).splitlines()[2:])


def test_a_code_names_what_is_wrong():
    """Not the argument that is wrong, and in one word of its own: a code is a promise to scripts."""
    codes = {fault.code for fault in tool("error_codes").faults(ROOT)}
    functions = filter(inspect.isfunction, tool("public").public_names().values())
    arguments = {name for each in functions for name in inspect.signature(each).parameters}
    kebab = re.compile(r"[a-z][a-z0-9]*(-([a-z0-9]+|…))*")
    assert [code for code in codes if not kebab.fullmatch(code)] == []
    assert {code for code in codes if code.replace("-", "_") in arguments} == set()
    assert len(codes) <= MOST_CODES


def test_figures_beside_peers_stand_on_the_pages_named():
    rows = re.findall(
        r"^\|[^|]+\|([^|]+)\|([^|]*)\|[^|]*`python -m [^|]+\|[^|(]+\(([^)#]+)\)",
        (DOCS / "peers.md").read_text("utf-8"),
        re.MULTILINE,
    )
    assert len(rows) > 10
    for figure, beside, page in rows:
        text = (DOCS / page).read_text("utf-8")
        for number in re.findall(r"(?<![\w.])\d[\d.,]*(?:e-\d+)?", f"{figure} {beside}"):
            assert number.rstrip(",.") in text, (number, page)


def test_every_dependency_has_its_line():
    """What each is for, and its licence."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    groups = [project["dependencies"], *project["optional-dependencies"].values()]
    wanted = {re.split(r"[<>=]", one)[0] for group in groups for one in group}
    page = (DOCS / "devdocs" / "architecture.md").read_text("utf-8").partition("## Dependencies")[2]
    rows = [line.split("|")[1] for line in page.splitlines() if line.startswith("| `")]
    assert set(re.findall(r"`([^`]+)`", " ".join(rows))) == wanted


def test_every_folder_is_on_the_page_of_the_architecture():
    page = (DOCS / "devdocs" / "architecture.md").read_text("utf-8")
    listed = set(re.findall(r"`(\w+/\w+)/`", page))
    packages = ("hysteresis", "identify", "compensate", "hysid")
    folders = {f"{p}/{d.name}" for p in packages for d in (ROOT / p).iterdir() if d.is_dir()}
    files = {folder for folder in folders if any((ROOT / folder).glob("*.py"))}
    assert listed == files


def test_links_between_pages_lead_somewhere():
    for page in (*PAGES, *ROOT.glob("*.md")):
        for link in re.findall(r"\]\(([^)#:\s]+)(?:#[^)]*)?\)", page.read_text("utf-8")):
            made = link.endswith("out/growth.svg")  # by `make docs`
            assert made or (page.parent / link).exists(), (page.name, link)
