"""Places that execute: the list in SECURITY.md is the code's."""

import ast
import re
from collections.abc import Iterator

from tests.sources import ROOT, trees

RUNS = {
    "exec", "eval", "compile", "__import__", "import_module", "Popen", "CDLL", "cdll", "PyDLL",
    "ProcessPoolExecutor", "entry_points",
}  # fmt: skip
"""Names of functions that run what they are given, whether they are called or handed on."""
MODULES = {
    "subprocess", "pickle", "marshal", "shelve", "runpy", "multiprocessing", "dill",
    "cloudpickle", "webbrowser", "pty", "distributed",
}  # fmt: skip
"""Modules whose functions do so, or read what does: who imports one is listed."""


def executes(tree: ast.AST) -> Iterator[str]:
    """What a file names that executes, or keeps compiled code."""
    for node in ast.walk(tree):
        named = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
        if isinstance(node, ast.Import | ast.ImportFrom):
            yield from RUNS & {one.name for one in node.names}
            named += [one.name for one in node.names if isinstance(node, ast.Import)]
            yield from MODULES & {name.split(".")[0] for name in named}
        elif isinstance(node, ast.Name):
            yield from RUNS & {node.id}
        elif isinstance(node, ast.Attribute):
            yield from RUNS & {node.attr} - {"compile", "eval", "exec"}  # re.compile
            if isinstance(node.value, ast.Name) and node.value.id == "os":
                kinds = "^(?:system|popen|exec|fork|spawn|posix_spawn|startfile).*"
                yield from re.findall(kinds, node.attr)
        elif isinstance(node, ast.Call):
            words = {k.arg: getattr(k.value, "value", True) for k in node.keywords}
            if getattr(node.func, "attr", getattr(node.func, "id", "")) == "njit":
                yield from {"cache"} & words.keys()
            yield from {"shell"} & words.keys()
            yield from {name for name in ("allow_pickle",) if words.get(name)}


def test_places_that_execute_are_listed():
    found = {name: run for name, tree in trees().items() if (run := set(executes(tree)))}
    assert not {"shell", "allow_pickle"} & set().union(*found.values())
    section = (ROOT / "SECURITY.md").read_text("utf-8").partition("## Every place that executes")[2]
    table = section.partition("## Every place that writes")[0]
    rows = [row.split("|")[0] for row in table.split("\n|")[1:]]
    listed = re.findall(r"`([^`]+\.py)`", "\n".join(rows))
    # JAX reads its programs by a setting, which is no call.
    assert set(listed) == {*found, "hysid/_compile_cache.py"}, found


def test_what_executes_is_found():
    bad = (
        "exec(x)", "map(eval, x)", "os.system(x)", "Thread(target=os.execv)", "import subprocess as s",
        "from webbrowser import open as show", "import webbrowser", "import pickle",
        "from multiprocessing import get_context", "import multiprocessing.pool",
        "from concurrent.futures import ProcessPoolExecutor as Pool", "njit(cache=True)",
        "concurrent.futures.ProcessPoolExecutor()", "f(x, shell=True)", "np.load(f, allow_pickle=x)",
    )  # fmt: skip
    for said in bad:
        assert list(executes(ast.parse(said))), said
    fine = "jnp.eval(x); re.compile(y); np.load(f, allow_pickle=False); import os"
    assert not list(executes(ast.parse(fine)))
    assert not list(executes(ast.parse("from concurrent.futures import ThreadPoolExecutor")))
