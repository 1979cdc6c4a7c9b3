"""Types and shapes of calls, checked while the tests run.

The hook of jaxtyping decorates inner functions too, which are made anew at each call, and binds the
arguments of each call, whether or not their annotations name shapes.
"""

import ast
import sys
from collections.abc import Callable
from dataclasses import is_dataclass
from functools import partial, wraps
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from importlib.util import cache_from_source
from typing import Any, TypeVar, get_args
from unittest.mock import patch

from beartype import BeartypeConf, beartype
from jaxtyping import AbstractArray, jaxtyped

NAME = "_checked_call"
CHECKED = 32
"""Calls of a function in a process that are checked: all of them would be a sixth of the tests' time."""
# PEP 484's tower: an int is a float. Callers know a wrong type as Python's own error.
_types = beartype(conf=BeartypeConf(is_pep484_tower=True, violation_type=TypeError))


def _names_shapes(annotation: Any) -> bool:
    """Whether an annotation holds an array with a shape. One that is a string may."""
    if isinstance(annotation, str):
        return True
    if isinstance(annotation, type) and issubclass(annotation, AbstractArray):
        return True
    if isinstance(annotation, TypeVar):
        parts = (*annotation.__constraints__, annotation.__bound__)
    elif isinstance(annotation, list | tuple):  # the arguments of a Callable
        parts = annotation
    else:
        parts = get_args(annotation)
    return any(map(_names_shapes, parts))


def checked(thing: Any) -> Any:
    """A function, or a class of data, whose first calls are checked."""
    if isinstance(thing, type):
        # Of an `__init__` that is written out this was done when it was defined.
        if is_dataclass(thing) and not hasattr(thing.__init__, NAME):
            thing.__init__ = checked(thing.__init__)
        return thing
    calls, checking = 0, None

    @wraps(thing)
    def call(*args: Any, **options: Any) -> Any:
        nonlocal calls, checking
        calls += 1
        if calls > CHECKED:
            return thing(*args, **options)
        if checking is None:  # most functions are not called in a process: made when it is needed
            shapes = any(map(_names_shapes, thing.__annotations__.values()))
            checking = jaxtyped(thing, typechecker=_types) if shapes else _types(thing)
        return checking(*args, **options)

    setattr(call, NAME, True)
    return call


def _decorate(body: list[ast.stmt]) -> None:
    """Functions and classes of a module, and methods, get `checked` around them."""
    for node in body:
        if isinstance(node, ast.If | ast.Try):
            for part in (node.body, node.orelse, getattr(node, "finalbody", [])):
                _decorate(part)
        elif isinstance(node, ast.FunctionDef | ast.ClassDef):
            if any(map(_unchecked, node.decorator_list)):
                continue
            decorator = ast.copy_location(ast.Name(NAME, ast.Load()), node)
            if isinstance(node, ast.ClassDef):
                node.decorator_list.insert(0, decorator)
                _decorate(node.body)
            else:  # the innermost: decorators such as JAX's take annotations away
                node.decorator_list.append(decorator)


def _unchecked(decorator: ast.expr) -> bool:
    return getattr(decorator, "id", getattr(decorator, "attr", "")) == "no_type_check"


class _Loader(SourceFileLoader):
    def source_to_code(self, data: Any, path: Any, **options: Any) -> Any:  # type: ignore[override]
        tree = ast.parse(data, path)
        _decorate(tree.body)
        return compile(tree, path, "exec", dont_inherit=True)

    def get_code(self, fullname: str) -> Any:
        name = partial(cache_from_source, optimization="checked")
        with patch("importlib._bootstrap_external.cache_from_source", name):
            return super().get_code(fullname)

    def exec_module(self, module: Any) -> None:
        setattr(module, NAME, checked)
        super().exec_module(module)


class _Finder:
    def __init__(self, wanted: Callable[[str], bool]) -> None:
        self.wanted = wanted

    def find_spec(self, name: str, path: Any = None, target: Any = None) -> ModuleSpec | None:
        spec = PathFinder.find_spec(name, path, target) if self.wanted(name) else None
        if spec is not None and type(spec.loader) is SourceFileLoader:
            spec.loader = _Loader(spec.loader.name, spec.loader.path)
        return spec


def install(wanted: Callable[[str], bool]) -> None:
    """From now on modules whose names are wanted are imported with their calls checked."""
    sys.meta_path.insert(0, _Finder(wanted))
