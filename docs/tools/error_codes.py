"""Every `InputError` of the source: code, problem, cause, fix."""

import ast
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import NamedTuple

MARK = "<!-- error codes -->"
PACKAGES = ("hysteresis", "identify", "compensate", "hysid")
HOLE = "…"
"""Marks a part of a message that is known only when it is printed."""


class Fault(NamedTuple):
    """One `InputError` of the source."""

    code: str
    problem: str
    cause: str
    fix: str
    module: str


_FIELDS = ("code", "problem")
_SHOWN = ("problem", "cause", "fix")


@cache
def faults(root: Path) -> list[Fault]:
    """All errors of the packages below `root`, by code; an error that several places raise, once."""
    sources = [
        Source(".".join(file.relative_to(root).with_suffix("").parts), file.read_text("utf-8"))
        for package in PACKAGES
        for file in sorted((root / package).rglob("*.py"))
    ]
    found: dict[tuple[str, ...], Fault] = {}
    for source in sources:
        for fault in _raised(source, sources):
            found.setdefault(fault[:4], fault)
    return sorted(found.values())


def table(root: Path) -> str:
    """The faults as a Markdown table, each code an anchor."""
    lines = ["| code | problem | likely cause | fix |", "|---|---|---|---|"]
    last = ""
    for fault in faults(root):
        code = f'<span id="{fault.code}"></span>`{fault.code}`' if fault.code != last else ""
        last = fault.code
        cells = [code, *map(_cell, fault[1:4])]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _cell(text: str) -> str:
    for sign in "\\|*_`[]<>$":
        text = text.replace(sign, "\\" + sign)
    return " ".join(text.split())


class Source:
    """A module: its calls by the function called, and the names of functions it imports."""

    def __init__(self, module: str, text: str):
        self.module = module
        self.calls: dict[str, list[ast.Call]] = {}
        self.imports: dict[tuple[str, str], str] = {}
        self.partials: dict[str, dict[str, list[ast.expr]]] = {}
        self.inside: dict[ast.AST, ast.FunctionDef] = {}
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.Call):
                self.calls.setdefault(_name(node.func), []).append(node)
            elif isinstance(node, ast.ImportFrom):
                home = (node.module or "").rpartition(".")[2]
                self.imports |= {(home, n.name): n.asname or n.name for n in node.names}
            elif isinstance(node, ast.FunctionDef):  # the innermost one is met last
                self.inside |= dict.fromkeys(ast.walk(node), node)
            elif isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
                value = node.value
                if isinstance(value, ast.Call) and _name(value.func) == "partial":
                    given = self.partials.setdefault(_name(value.args[0]), {})
                    given[node.targets[0].id] = value.args[1:]

    def called(self, home: "Source", function: str) -> Iterator[tuple[list[ast.expr], ast.Call]]:
        """Every call of a function of a module, with the arguments that a `partial` puts before its own."""
        last = home.module.rpartition(".")[2]
        name = function if self is home else self.imports.get((last, function))
        if name is not None:
            known = {name: []} | self.partials.get(name, {})
            for known_as, first in known.items():
                for call in self.calls.get(known_as, ()):
                    yield first, call


def _raised(source: Source, sources: Sequence[Source]) -> Iterator[Fault]:
    for call in source.calls.get("InputError", ()):
        function = source.inside.get(call)
        for arguments in _passed(source, function, sources) if function else [{}]:
            names = arguments | (_assigned(function, call.lineno) if function else {})
            given = _given(call, _FIELDS)
            for code in _codes(given.get("code"), names):
                if code != HOLE:
                    told = [_text(given[k], names) if k in given else "" for k in _SHOWN]
                    yield Fault(code, told[0], told[1], told[2], source.module)


def _given(call: ast.Call, order: Sequence[str], first: Sequence[ast.expr] = ()) -> dict:
    """Arguments of a call by name."""
    by_place = dict(zip(order, [*first, *call.args], strict=False))
    return by_place | {k.arg: k.value for k in call.keywords if k.arg}


def _passed(
    source: Source, function: ast.FunctionDef, sources: Sequence[Source]
) -> list[dict[str, ast.expr]]:
    """The arguments that callers pass to a function that makes errors; one empty answer without callers."""
    arguments = [*function.args.posonlyargs, *function.args.args]
    order = [a.arg for a in arguments if a.arg not in ("self", "cls")]
    rest = arguments[len(arguments) - len(function.args.defaults) :]
    defaults = dict(zip((a.arg for a in rest), function.args.defaults, strict=True))
    calls = [
        defaults | _given(call, order, first)
        for other in sources
        for first, call in other.called(source, function.name)
    ]
    return calls or [{}]


def _assigned(function: ast.FunctionDef, line: int) -> dict[str, ast.expr]:
    """The last value assigned to each name of a function above a line."""
    found: dict[str, ast.expr] = {}
    made = (n for n in ast.walk(function) if isinstance(n, ast.Assign) and n.lineno < line)
    for node in sorted(made, key=lambda n: n.lineno):
        for target in node.targets:
            if isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple):
                pairs = zip(target.elts, node.value.elts, strict=False)
            else:
                pairs = [(target, node.value)]
            found |= {name.id: value for name, value in pairs if isinstance(name, ast.Name)}
    return found


def _codes(node: ast.expr | None, names: Mapping[str, ast.expr]) -> list[str]:
    if isinstance(node, ast.IfExp):
        return _codes(node.body, names) + _codes(node.orelse, names)
    return [] if node is None else [_text(node, names)]


def _text(node: ast.expr | None, names: Mapping[str, ast.expr], depth: int = 0) -> str:
    """The text of an expression, with holes for what is known only when it runs."""
    if isinstance(node, ast.Constant):
        return str(node.value)
    if isinstance(node, ast.JoinedStr):
        return "".join(
            _text(part.value if isinstance(part, ast.FormattedValue) else part, names, depth + 1)
            for part in node.values
        )
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        return _text(node.left, names, depth) + _text(node.right, names, depth)
    if isinstance(node, ast.IfExp):
        return _text(node.body, names, depth)
    if isinstance(node, ast.Name) and node.id in names and depth < 4:
        value = names[node.id]
        rest = {k: v for k, v in names.items() if k != node.id}
        return _text(value, rest, depth + 1)
    return HOLE


def _name(function: ast.expr) -> str:
    if isinstance(function, ast.Name):
        return function.id
    return function.attr if isinstance(function, ast.Attribute) else ""
