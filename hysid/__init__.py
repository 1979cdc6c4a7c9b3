"""hysid: from a test rig's CSV to a compensator that can be trusted inside a robot.

The names people use most, in one place; each loads its package when it is first used. `__init__.pyi`
lists them once, for type checkers and for this file.
"""

# hysid:own-package, which hysid/_packages.py looks for

import ast
from importlib import import_module
from pathlib import Path
from typing import Any

from ._packages import fault_of_packages, is_command

if (_fault := fault_of_packages()) and not is_command():
    raise ImportError(_fault)

_HOME = {
    alias.name: str(node.module)
    for node in ast.parse(Path(__file__).with_suffix(".pyi").read_text("utf-8")).body
    if isinstance(node, ast.ImportFrom)
    for alias in node.names
}
__all__ = sorted(_HOME)


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'hysid' has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return __all__
