"""Places that execute: the list in SECURITY.md is the code's."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("hysteresis", "identify", "compensate", "hysid")
RUNS = {"exec", "eval", "compile", "__import__", "import_module", "Popen", "CDLL"}
"""Names of functions that run what they are given, however they are reached."""
MODULES = {
    "subprocess",
    "pickle",
    "marshal",
    "shelve",
    "runpy",
    "multiprocessing",
    "dill",
    "cloudpickle",
}
"""Modules whose functions do so, or read what does."""


def calls(tree: ast.AST) -> Iterator[str]:
    """What a file calls that executes, or keeps compiled code."""
    for node in ast.walk(tree):
        if not isinstance(node, ast.Call):
            continue
        function, first = node.func, node.func
        while isinstance(first, ast.Attribute):
            first = first.value
        owner = first.id if isinstance(first, ast.Name) else ""
        name = function.id if isinstance(function, ast.Name) else getattr(function, "attr", "")
        plain = isinstance(function, ast.Name) or name not in ("compile", "eval", "exec")
        by_os = owner == "os" and re.match("system|popen|exec|spawn|posix_spawn", name)
        if (name in RUNS and plain) or owner in MODULES or by_os:
            yield name
        if name == "entry_points" or any(k.arg == "cache" for k in node.keywords if name == "njit"):
            yield name
        if any(k.arg == "shell" for k in node.keywords):
            yield "shell"
        if any(k.arg == "allow_pickle" and getattr(k.value, "value", True) for k in node.keywords):
            yield "allow_pickle"


def test_places_that_execute_are_listed():
    found: dict[str, set[str]] = {}
    for package in PACKAGES:
        for file in (ROOT / package).rglob("*.py"):
            if run := set(calls(ast.parse(file.read_text("utf-8")))):
                found[str(file.relative_to(ROOT))] = run
    assert not {"shell", "allow_pickle"} & set().union(*found.values())
    section = (ROOT / "SECURITY.md").read_text("utf-8").partition("## Every place that executes")[2]
    table = section.partition("## Every place that writes")[0]
    listed = re.findall(
        r"`([^`]+\.py)`", "\n".join(row.split("|")[0] for row in table.split("\n|")[1:])
    )
    # JAX reads its programs by a setting, which is no call.
    assert set(listed) == {*found, "hysid/_compile_cache.py"}, found


def test_calls_that_execute_are_found():
    for said in (
        "exec(x)",
        "os.system(x)",
        "subprocess.run(x)",
        "f(x, shell=True)",
        "pickle.load(f)",
    ):
        assert list(calls(ast.parse(said)))
    assert not list(calls(ast.parse("jnp.eval(x); re.compile(y); np.load(f, allow_pickle=False)")))
