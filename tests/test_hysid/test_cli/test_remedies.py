"""What commands recommend: every option exists where it is said, and every command that is printed runs."""

import ast
import html
import re
import shlex
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from tests.sources import trees
from tests.test_hysid.command import COMMANDS, F, T, X, example, put, run, takes, text
from tests.test_hysid.test_cli.test_bad_inputs import COMMA, RESET, ROWS, cell
from tests.thorough import rest_thorough

OPTION = re.compile(r"(?<![\w-])--[a-z][a-z0-9-]*[a-z0-9](?!\w)")
ELSEWHERE = re.compile(r"hysid ([a-z]+)( [^;,.)]*)?|pip \S+[^;,.)]*|rostopic [^;,.)]*")
COLUMNS = ("--input", F, "--output", X)
FAST = ("--model", "LinearSponge", "--noise", "gaussian", "--starts", 1)

pytestmark = pytest.mark.usefixtures("empty_folder")


def options_of_command(command: Any) -> set[str]:
    return {name for one in command.params for name in (*one.opts, *one.secondary_opts)}


@cache  # two seconds
def sources() -> list[tuple[str, list[ast.AST], set[int]]]:
    """The texts of each file of the packages, and which of them are docstrings, by `id`."""
    found, kinds = [], ast.Module | ast.ClassDef | ast.FunctionDef
    for path, tree in trees().items():
        nodes = list(ast.walk(tree))
        texts = [node for node in nodes if isinstance(node, ast.Constant | ast.JoinedStr)]
        first = [node.body[0] for node in nodes if isinstance(node, kinds) and node.body]
        docstrings = {id(one.value) for one in first if isinstance(one, ast.Expr)}
        found.append((path, texts, docstrings))
    return found


def test_options_in_messages_exist():
    known = set().union({"--help", "--version"}, *map(options_of_command, COMMANDS.values()))
    faults = []
    for place, nodes, _ in sources():
        for node in nodes:
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                said = OPTION.findall(ELSEWHERE.sub("", node.value))
                faults += [(place, name) for name in said if name not in known]
    assert faults == []


WORD = (
    r"""(?:'[^'\n]*'|"[^"\n]*"|--[a-z][a-z-]*|[A-Z][A-Z]*(?:\.[a-z]+)?|[\w*/-]+\.(?:csv|toml|json|h)\b"""
    r"""|\d[\d.e-]*|\{\})"""
)
CALL = re.compile(rf"hysid ((?:(?:armor|microchannel|datasets) )?[a-z][a-z-]*)((?: {WORD})+)")


def calls() -> dict[tuple[str, str], str]:
    """Commands with arguments that the source names in messages, and where; {} for what varies."""
    found = {}
    for place, nodes, docstrings in sources():
        nodes = [node for node in nodes if id(node) not in docstrings]
        inner = {id(v) for node in nodes if isinstance(node, ast.JoinedStr) for v in node.values}
        for node in nodes:
            parts = node.values if isinstance(node, ast.JoinedStr) else [node]
            parts = [p.value if isinstance(p, ast.Constant) else "{}" for p in parts]
            text = parts and id(node) not in inner and isinstance(parts[0], str)
            if text and isinstance(node, ast.JoinedStr | ast.Constant):
                for call in CALL.finditer("".join(parts)):
                    found[call[1], call[2]] = place
    return found


def test_commands_in_messages_are_complete():
    """Each option is one of the command; and where arguments are given, none is missing."""
    put(ROWS)  # which some of them name
    faults, tried = [], 0
    for (name, said), place in calls().items():
        command, words = COMMANDS.get(name), shlex.split(said.replace("VALUE", "1"))
        if command is None:  # a sentence with hysid as its subject
            assert "--" not in said, (name, said, place)
            continue
        have = options_of_command(command)
        faults += [(place, name, word) for word in words if word[:2] == "--" and word not in have]
        mentions = words[0].startswith("--") or words[-1].startswith("--")
        if "{}" not in words and not mentions:
            tried += 1
            try:
                command.make_context(name, words)
            except Exception as error:  # click's own
                faults.append((place, name, str(error)))
    assert tried > 8
    assert faults == []


def test_examples_of_help_are_complete():
    """Every command has an example, whose options and arguments it takes."""
    for name in COMMANDS:
        words, own = example(name), name.split()
        assert words[: len(own)] == own
        takes(name, words[len(own) :])


BAD = {
    "decimal commas": COMMA, "overload": cell(X, "OVLD"), "an output is missing": cell(X, ""),
    "an input is missing": cell(F, ""), "time goes back": RESET,
    "time stands still": cell(T, ROWS[8][0], 9),
    "an unknown unit": text(ROWS, (T, F, "displacement (furlong!)", "cycle")),
    "a column is lost": text(ROWS, (T, "load (N)", X, "cycle")),
    "mass": text(ROWS, (T, "force (kg)", X, "cycle")),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_each_option_that_is_recommended_is_one_of_the_command(name):
    put(BAD[name], "bad.csv")
    put(ROWS, "good.csv")
    unit = "furlong!" if name == "an unknown unit" else ""
    output = f"displacement ({unit})" if unit else X
    columns = ("--input", "force (kg)" if name == "mass" else F, "--output", output, "--time", T)
    columns = ("bad.csv", *columns)
    for arguments in (("init", "bad.csv"), ("check", *columns), ("fit", *columns)):
        result = run(*arguments, *(FAST if arguments[0] == "fit" else ()))
        said = ELSEWHERE.sub("", result.err)
        have = options_of_command(COMMANDS[arguments[0]])
        assert set(OPTION.findall(said)) <= have | {"--help"}, (arguments[0], result.err)


def test_a_command_that_lacks_the_option_names_the_one_that_has_it():
    assert run("fit", put(ROWS), *COLUMNS, "--time", T, *FAST, "--out", "it").code == 0
    lost = run("predict", "it", put(BAD["a column is lost"], "new.csv"))
    assert lost.code == 2
    assert "--input" not in lost.err
    stood = run("predict", "it", put(BAD["time stands still"], "new.csv"))
    assert stood.code == 2
    assert "--dt" not in stood.err or "hysid fit --help" in stood.err
    comma = put(BAD["decimal commas"], "comma.csv")
    assert "--decimal" in run("predict", "it", comma).err
    assert run("predict", "it", comma, "--decimal", ",").code == 0


def printed(lines: str) -> list[list[str]]:
    """The commands that stand on lines of their own."""
    own = [line for line in map(str.strip, lines.split("\n")) if line[:6] == "hysid "]
    return [shlex.split(line)[1:] for line in own]


def test_what_init_prints_runs():
    name = 'my "rig" (N)'
    put(text(ROWS, (T, '"my ""rig"" (N)"', X, "cycle")), "a b.csv")
    found = printed(run("init", "a b.csv").out)
    assert [words[0] for words in found] == ["init", "fit"]
    assert any(name in words for words in found)
    for words in found:
        assert run(*words, *(FAST if words[0] == "fit" else ())).code == 0
    assert run("init", "a b.csv", "--overwrite").code == 0


@pytest.mark.parametrize(
    ("cycles", "held"),
    rest_thorough([(5, ("--test-cycles", 1)), (1, ()), (1, ("--test-cycles", 1)), (5, ())], 1),
)
def test_what_a_report_prints_runs(cycles, held):
    put(text([row for row in ROWS if int(row[3]) <= cycles]), "a b.csv")
    if cycles == 1 and held:
        held = ("--test-tail", 0.25)
    assert run("fit", "a b.csv", *COLUMNS, "--time", T, *held, *FAST, "--out", "it's").code == 0
    assert run("report", "it's").code == 0
    page = Path("it's/report.html").read_text("utf-8")
    code = re.findall(r"<code>(.*?)</code>", page)
    code = [html.unescape(re.sub(r"<[^>]*>", "", c)) for c in code]
    found = [shlex.split(line)[1:] for line in code if line.startswith("hysid ")]
    assert found
    for words in found:
        if words[0] == "sample":  # for seconds: its options are there
            takes("sample", words[1:])
        else:
            assert run(*words, *(FAST if words[0] == "fit" else ())).code == 0, words
