"""The blocks of a page that are run: Python as cells of one notebook, and commands with their output.

The build turns them into cells (`as_notebook`), the tests run the same blocks in their own process
(`blocks`, `run`).
"""

import ast
import os
import re
import shlex
import subprocess
import sys
import tempfile
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).resolve().parents[2]
FENCE = re.compile(r"^```(python|console)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
COMMAND = re.compile(r"^\$ ((?:.*\\\n)*.*)", re.MULTILINE)
NAMES = re.compile(r"^```\{api\} ([\w.]+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)

HEAD = """---
file_format: mystnb
kernelspec: {name: python3}
language_info: {name: python, pygments_lexer: python}
---
"""
SETUP = f"""
```{{code-cell}} python
:tags: [remove-cell]
%matplotlib inline
%config InlineBackend.figure_formats = ["svg"]
import os, sys
os.chdir({str(ROOT)!r})
sys.path.append({str(Path(__file__).parent)!r})
from cells import console
```
"""


class Block(NamedTuple):
    """The text between two fences, and the line on which it begins."""

    kind: str
    code: str
    line: int


def blocks(text: str) -> list[Block]:
    """The blocks of a page that are run, in order."""
    return [
        Block(found[1], found[2], text.count("\n", 0, found.start()) + 2)
        for found in FENCE.finditer(text)
    ]


def as_notebook(text: str) -> str:
    """The page as a MyST notebook: a cell for each block, and one before them that is not shown."""
    if not FENCE.search(text):
        return text
    title, newline, rest = text.partition("\n")
    return HEAD + title + newline + SETUP + FENCE.sub(_cell, rest)


def _cell(found: re.Match[str]) -> str:
    if found[1] == "python":
        return f"```{{code-cell}} python\n{found[2]}```"
    return f"```{{code-cell}} python\n:tags: [remove-input]\nconsole({found[2]!r})\n```"


def console(commands: str) -> None:
    """Run the commands that begin with `$`, and print them and their output as a terminal does.

    A backslash at the end of a line continues it on the next. All commands of a page run in one folder,
    which holds `datasets` and is removed when the page has been run.

    Raises `subprocess.CalledProcessError` if a command ends with an error.
    """
    beside = str(Path(sys.executable).parent)
    environment = os.environ | {"COLUMNS": "100", "NO_COLOR": "1", "TERM": "dumb"}
    environment["PATH"] = os.pathsep.join((beside, environment.get("PATH", "")))
    environment["MPLBACKEND"] = "agg"
    for command in COMMAND.findall(commands):
        done = subprocess.run(
            shlex.split(command.replace("\\\n", " ")),
            cwd=_folder().name,
            env=environment,
            text=True,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
        )
        print(f"$ {command}\n{done.stdout.replace(_folder().name + os.sep, '')}", flush=True)
        done.check_returncode()


@cache
def _folder() -> tempfile.TemporaryDirectory[str]:
    made = tempfile.TemporaryDirectory(prefix="hysid-docs-")
    Path(made.name, "datasets").symlink_to(ROOT / "datasets")
    return made


def run(code: str, names: dict[str, Any], place: str) -> Any:
    """Run a block of Python; the value of its last line, where that is an expression."""
    tree = ast.parse(code, place)
    last = tree.body[-1]
    if not isinstance(last, ast.Expr):
        exec(compile(tree, place, "exec"), names)
        return None
    exec(compile(ast.Module(tree.body[:-1], []), place, "exec"), names)
    return eval(compile(ast.Expression(last.value), place, "eval"), names)
