"""Packages that load a name when it is first used; `__init__.pyi` lists the names, once."""

import ast
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any


def loaded_late(
    package: str, file: str, made: Callable[[str, Any], Any] = lambda name, found: found
) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """`__getattr__`, `__dir__` and `__all__` of a package, by the `.pyi` beside its `__init__`, `file`.

    `made(name, found)` is what users get of a name.
    """
    home = {
        alias.name: ("." * node.level + (node.module or alias.name), node.module is None)
        for node in ast.parse(Path(file).with_suffix(".pyi").read_text("utf-8")).body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    names = sorted(home)

    def get(name: str) -> Any:
        if name not in home:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        path, is_module = home[name]
        module = import_module(path, package)
        found = made(name, module if is_module else getattr(module, name))
        return vars(sys.modules[package]).setdefault(name, found)

    return get, lambda: names, names
