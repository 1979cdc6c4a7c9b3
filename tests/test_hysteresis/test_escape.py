"""Text of strangers stays text, whatever language it is written into."""

import ctypes
import html
import json
import shutil
import subprocess
import tomllib
from html.parser import HTMLParser
from pathlib import Path
from xml.etree import ElementTree

import jinja2
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hysteresis._escape import (
    c_comment,
    c_string,
    json_text,
    markup,
    shell_word,
    toml_comment,
    toml_string,
    visible,
)
from tests.c_harness import ran

HOSTILE = (
    "*/ int planted = system(\"true\"); /*", "/*raw*/", "// force", "a*", "*", "/", "*/", "**//**//",
    "end\\", "a \\\n*/", "what??/", "????/\n*/", "??)", "two\nlines", "\r\n", "a\0b", "\x1b[2J", "\x9b31m",
    "\u202edesrever\u202c", "\u2066isolated\u2069", "\u200f", "\u2028", "\udc80half", '"', "'", '"""',
    "'''",
    "</script><script>alert(1)</script>", "<!-- -->", "--><svg onload=alert(1)>", "]]>", "&amp;",
    "$(touch planted)", "`touch planted`", "; touch planted", "$IFS", "'$(touch planted)'", "%s%n",
    "{{7*7}}", "{% raw %}", "$\\frac$", "=cmd|' /C calc'!A0", "µm", "°C", "力 (N)", "#define", "\ufeff",
)  # fmt: skip
"""Names that a column may have and that meant something once they were written elsewhere."""

ALPHABET = "".join(sorted({c for name in HOSTILE for c in name}))
names = st.one_of(
    st.sampled_from(HOSTILE), st.text(st.sampled_from(ALPHABET), max_size=30),
    st.text(max_size=30), st.text("*/\\?\n\"'", max_size=12),
)  # fmt: skip


def stripped(source: str) -> str:
    """What a C compiler sees of a source: trigraphs, continued lines, comments, in that order."""
    for mark, is_for in zip("=/'()!<>-", "#\\^[]|{}~", strict=True):
        source = source.replace(f"??{mark}", is_for)
    source, out, k = source.replace("\\\n", ""), [], 0
    while k < len(source):
        if source.startswith("/*", k):
            end = source.index("*/", k + 2)
            assert "/*" not in source[k + 2 : end]
            k = end + 2
        else:
            out.append(source[k])
            k += 1
    return "".join(out)


@given(names)
def test_a_comment_in_c_stays_one(name: str):
    found = c_comment(name)
    assert stripped(f"x/* {found} */y") == "xy"
    assert stripped(f"x/*{found}.*/y") == "xy"
    assert f"{found}|".isprintable()
    assert "//" not in found
    assert c_comment(found) == found


@pytest.mark.parametrize("compiler", [c for c in ("gcc", "g++", "clang") if shutil.which(c)])
def test_a_compiler_reads_them_back(compiler: str, tmp_path: Path):
    """Every hostile name, in a comment and as a string, by a strict compiler; as C++ too."""
    language = ["-x", "c++", "-std=c++11", "-trigraphs"] if compiler == "g++" else ["-std=c99"]
    plain = [name.replace("\0", "0") for name in HOSTILE]
    lines = [f"/* {c_comment(name)} */" for name in plain]
    lines += [f"static const char *const names[] = {{{', '.join(map(c_string, plain))}}};"]
    head = 'extern "C" ' if compiler == "g++" else ""
    lines += [f"{head}const char *name(int k);", "const char *name(int k) { return names[k]; }"]
    source, library = tmp_path / "names.c", tmp_path / "names.so"
    source.write_text("\n".join(lines) + "\n", "utf-8")
    warnings = ("-Wall", "-Wextra", "-Wcomment", "-Wtrigraphs", "-Werror")
    ran(compiler, *language, *warnings, "-shared", "-fPIC", source, "-o", library)
    function = ctypes.CDLL(str(library)).name
    function.restype = ctypes.c_char_p
    found = [function(k) for k in range(len(plain))]
    assert found == [name.encode("utf-8", "backslashreplace") for name in plain]


class Tags(HTMLParser):
    """The tags and the text of a page."""

    def __init__(self) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.words: list[str] = []
        self.titles: list[str | None] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.titles += [value for name, value in attrs if name == "title"]
        assert {name for name, _ in attrs} <= {"title"}

    def handle_data(self, data: str) -> None:
        self.words.append(data)


@given(names)
def test_markup_is_text(name: str):
    text, page = markup(name), Tags()
    page.feed(f'<p title="{text}">{text}</p>')
    page.close()
    assert page.tags == ["p"]
    seen = visible(name, keep="\n\t")
    assert (page.titles, "".join(page.words)) == ([seen], seen)
    parsed = ElementTree.fromstring(f"<text>{text}</text>".encode())
    assert (parsed.text or "") == seen
    assert not len(parsed)
    assert jinja2.Environment(autoescape=True).from_string("{{ it }}").render(it=name) is not None
    assert html.unescape(text) == seen


@given(names)
def test_toml_and_json_are_read_back(name: str):
    whole = name.encode("utf-8", "replace").decode() == name
    line = f"# {toml_comment(name)}\nname = {toml_string(name)} # {toml_comment(name)}\nlast = 1\n"
    found = tomllib.loads(line.encode().decode())
    assert set(found) == {"name", "last"}
    assert found["name"] == name or not whole
    text = json_text(json.dumps({"name": name}, ensure_ascii=False))
    assert json.loads(text.encode()) == {"name": name}


def test_a_shell_sees_one_word(tmp_path: Path):
    """All hostile names at once: bash prints each as it is, and runs nothing."""
    words = [name for name in HOSTILE if "\0" not in name]
    script = f"printf '%s\\0' {' '.join(map(shell_word, words))}\n"
    assert all(shell_word(word).isprintable() for word in words)
    bash = shutil.which("bash")
    if bash is None:
        pytest.skip("no bash")
    done = subprocess.run([bash, "-c", script], capture_output=True, cwd=tmp_path, check=True)
    found = done.stdout.split(b"\0")[:-1]
    assert found == [word.encode("utf-8", "surrogateescape") for word in words]
    assert not list(tmp_path.iterdir())
