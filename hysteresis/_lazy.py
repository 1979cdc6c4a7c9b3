"""Packages that load a name when it is first used; `__init__.pyi` lists the names, once."""

import ast
from pathlib import Path


def homes(file: str) -> dict[str, str]:
    """The module of each name of a package, by the `.pyi` beside its `__init__`, which is `file`."""
    return {
        alias.name: "." * node.level + (node.module or alias.name)
        for node in ast.parse(Path(file).with_suffix(".pyi").read_text("utf-8")).body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
