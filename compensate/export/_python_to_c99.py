"""Translation of the runtime's elements from Python to C99, statement by statement."""

import ast
import inspect
import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

from hysteresis import InputError
from hysteresis._escape import c_comment
from hysteresis.laws import _codes
from hysteresis.running._law import MATHS, Law, law

_INDENT = "    "
_OPERATORS = {
    ast.Add: ("+", 12), ast.Sub: ("-", 12), ast.Mult: ("*", 13), ast.Div: ("/", 13),
    ast.FloorDiv: ("/", 13), ast.Mod: ("%", 13), ast.Lt: ("<", 10), ast.LtE: ("<=", 10),
    ast.Gt: (">", 10), ast.GtE: (">=", 10), ast.Eq: ("==", 9), ast.NotEq: ("!=", 9),
    ast.And: ("&&", 5), ast.Or: ("||", 4),
}  # fmt: skip
_ATOM = 20
_KINDS = {"float": "real", "None": "void"}


@dataclass(frozen=True)
class Expression:
    """C text, its type ("int" or "real"), and how strongly it binds."""

    text: str
    type: str
    level: int = _ATOM

    def within(self, level: int) -> str:
        """The text, in parentheses where it binds less."""
        return self.text if self.level >= level else f"({self.text})"


@dataclass
class Element:
    """A law in C: names begin with `stem` and `kind`, numbers are `real`."""

    law: Law
    stem: str
    kind: str
    real: str
    single: bool
    common: dict[str, str] = field(default_factory=dict)
    """Functions that were translated once for all nodes of this kind, by their names in C."""

    def __post_init__(self) -> None:
        # The C code keeps comments for its readers.
        self.comments = {
            line: t.string.lstrip("# ")
            for line, t in self.law.comments.items()
            if t.line.lstrip().startswith("#")
        }
        module = self.law.module
        self.functions = {
            name: node for name, node in self.law.functions.items()
            if getattr(module, name).__module__ == module.__name__
        }  # fmt: skip
        self.structures = {
            name: {f: _KINDS.get(kind, kind) for f, kind in fields.items()}
            for name, fields in self.law.fields.items()
        }
        self.about = inspect.getdoc(module) or ""

    @property
    def prefix(self) -> str:
        return f"{self.stem}_{self.kind}"

    def borrowed(self, name: str) -> "Element":
        """The element that a function was imported from, its names among ours."""
        owner = getattr(self.law.module, name).__module__
        return Element(law(owner.rpartition(".")[2]), self.stem, self.kind, self.real, self.single)

    def structure(self, name: str, lengths: dict[str, int] | None = None) -> str:
        """`Parameters`, arrays as pointers to constants, or `State`, arrays of the given lengths."""
        about = inspect.getdoc(getattr(self.law.module, name)) or ""
        lines = [comment(about, ""), "typedef struct {"]
        for key, kind in self.structures[name].items():
            if kind == "Reals" and lengths is None:
                lines.append(f"{_INDENT}const {self.real} *{key};")
            elif kind == "Reals":
                lines.append(f"{_INDENT}{self.real} {key}[{max((lengths or {}).get(key, 1), 1)}];")
            else:
                lines.append(f"{_INDENT}{'int' if kind == 'int' else self.real} {key};")
        return "\n".join([*lines, f"}} {self.prefix}_{name.lower()};"])

    def translated(self) -> str:
        """All functions, what they call before them."""
        done: dict[str, str] = {}
        for node in self.functions.values():
            if not any(_kind(a.annotation) == "Callable" for a in node.args.args):
                Function(self, node, {}, done).translate()
        self.common = done
        return "\n\n".join(done.values())


def element(kind: str, stem: str, single: bool) -> Element:
    """By the name of its module."""
    return Element(law(kind), stem, kind, f"{stem}_real", single)


def comment(text: str, indent: str) -> str:
    """Text as a C comment, each of its lines escaped."""
    lines = [c_comment(line) for line in inspect.cleandoc(text).split("\n")]
    if len(lines) == 1:
        return f"{indent}/* {lines[0]} */"
    body = "\n".join(f"{indent} * {line}".rstrip() for line in lines[1:])
    return f"{indent}/* {lines[0]}\n{body}\n{indent} */"


def number(value: float, single: bool) -> str:
    """A literal."""
    if math.isnan(value) or math.isinf(value):
        raise InputError(
            "not-finite", "a number of the model is not finite, so it has no literal in C."
        )
    if single and abs(value) < 2.0**-150:  # compilers warn of literals that are zero as floats
        value = 0.0
    text = f"{value:.9g}" if single else repr(float(value))
    text = text if any(c in text for c in ".e") else f"{text}.0"
    return f"{text}f" if single else text


class Function:
    """One function on its way to C. `home`: its `Element`, or what stands for it. `given`: C names of the
    functions it takes, C types of what is Any."""

    def __init__(
        self,
        home: Element | SimpleNamespace,
        node: ast.FunctionDef,
        given: dict[str, str],
        done: dict[str, str],
    ):
        self.home: Any = home
        self.node, self.given, self.done = node, given, done
        # C has no closures. A function that takes another one is written once for each it is called with,
        # under that one's name, so that the copies differ and the compiler can inline the call.
        base = given["look"].removesuffix("_look") if "look" in given else home.prefix
        self.name = f"{base}_{node.name}"
        self.body = node.body[bool(ast.get_docstring(node)) :]
        self.kinds = {a.arg: _kind(a.annotation) for a in node.args.args}
        self.types = dict(self.kinds)
        self.kind = _kind(node.returns)
        self.returns = home.real if self.kind == "real" else self.kind
        self.locals = self._infer()
        self.declared: dict[int, list[str]] = {}
        for name in self.locals:
            self.declared.setdefault(id(_first(self.body, name)), []).append(name)

    def _argument(self, name: str) -> str:
        kind, home = self.kinds[name], self.home
        return {
            "Any": f"{self.given.get(name)} *{name}",
            "Parameters": f"const {home.prefix}_parameters *{name}",
            "State": f"{home.prefix}_state *{name}",
            "Reals": f"const {home.real} *{name}",
            "int": f"int {name}",
        }.get(kind, f"{home.real} {name}")

    def translate(self) -> str:
        """Add its text to `done`, after the functions that it calls, and return its name."""
        if self.name in self.done or self.name in self.home.common:
            return self.name
        # Translating the body translates what it calls, and C wants a function before its first call:
        # `done` keeps the order in which functions are finished, so the body comes first.
        body = self._block(self.body, _INDENT)
        used = self._used()
        taken = [name for name, kind in self.kinds.items() if kind != "Callable"]
        # All functions of one kind share their arguments; compilers warn about those a body does not use.
        unused = [f"{_INDENT}(void){name};" for name in taken if name not in used]
        arguments = ", ".join(map(self._argument, taken))
        about = ast.get_docstring(self.node)
        lines = [comment(about, "")] if about else []
        lines.append(f"static inline {self.returns} {self.name}({arguments})")
        self.done[self.name] = "\n".join([*lines, "{", *unused, *body, "}"])
        return self.name

    def _used(self) -> set[str]:
        return set().union(*map(_names, self.body))

    # Statements

    def _infer(self) -> dict[str, str]:
        """Types of the variables: real where any assigned value is real."""
        found: dict[str, str] = {}
        sets = self.sets = [
            n for n in ast.walk(self.node) if isinstance(n, ast.Assign) and _target(n)
        ]
        self.types |= {_target(n): "int" for n in sets if _target(n) not in self.kinds}
        self.types |= {
            n.target.id: "int" for n in ast.walk(self.node)
            if isinstance(n, ast.For) and isinstance(n.target, ast.Name)
        }  # fmt: skip
        # In a loop a variable may take its type from one that is assigned further down. A type that became
        # real stays real, so passes can be repeated; three follow a chain of three assignments.
        for node in [*sets, *sets, *sets]:
            name = _target(node)
            if name not in self.kinds:
                kind = self._expression(node.value, quiet=True).type
                kind = "real" if "real" in (kind, self.types[name]) else kind
                found[name] = self.types[name] = kind
        return found

    def _field(self, node: ast.Attribute) -> str:
        assert isinstance(node.value, ast.Name)
        return self.home.structures[self.types[node.value.id]][node.attr]

    def _is_constant(self, array: ast.expr) -> bool:
        """Whether an array is one of the model's tables: all are, but those of the state."""
        names = {n.id for n in ast.walk(array) if isinstance(n, ast.Name)}
        return "State" not in {self.types[name] for name in names} and all(
            self._is_constant(n.value)
            for n in self.sets
            if _target(n) in names and self.types[_target(n)] == "Reals"
        )

    def _block(self, body: list[ast.stmt], indent: str) -> list[str]:
        lines: list[str] = []
        for before, node in zip([None, *body], body, strict=False):
            lines += self._comments(node, before, indent)
            # A variable that is first set within a branch or loop, and used after it, is declared before
            # that statement; one that this statement sets is declared by the assignment itself.
            fresh = self.declared.get(id(node), [])
            lines += [f"{indent}{self._declare(n)};" for n in fresh if n != _target(node)]
            lines += self._statement(node, indent)
        return lines

    def _declare(self, name: str) -> str:
        kind, real = self.locals[name], self.home.real
        constant = "const " if self._is_constant(ast.Name(name)) else ""
        return {"int": f"int {name}", "Reals": f"{constant}{real} *{name}"}.get(
            kind, f"{real} {name}"
        )

    def _comments(self, node: ast.stmt, before: ast.stmt | None, indent: str) -> Iterator[str]:
        """What stands in the lines above a statement."""
        lines: list[str] = []
        at = node.lineno - 1
        while at in self.home.comments and at > ((before and before.end_lineno) or 0):
            lines.insert(0, self.home.comments[at])
            at -= 1
        if lines:
            yield comment("\n".join(lines), indent)

    def _statement(self, node: ast.stmt, indent: str) -> list[str]:
        deeper = indent + _INDENT
        match node:
            case ast.Assign():
                return [f"{indent}{self._assignment(node)};"]
            case ast.Return():
                value = f" {self._as(node.value, self.returns)}" if node.value else ""
                return [f"{indent}return{value};"]
            case ast.Expr():
                return [f"{indent}{self._expression(node.value).text};"]
            case ast.While():
                most, test = self.home.law.bounds[node.lineno], self._expression(node.test).text
                head = f"{indent}while ({test}) {{ /* at most: {most} */"
                return [head, *self._block(node.body, deeper), f"{indent}}}"]
            case ast.For(target=ast.Name(id=k), iter=ast.Call(args=ends)):
                # range(n) or range(m, n): the last two of ["0", m, n].
                first, last = ["0", *(self._expression(e).text for e in ends)][-2:]
                head = f"{indent}for (int {k} = {first}; {k} < {last}; ++{k}) {{"
                return [head, *self._block(node.body, deeper), f"{indent}}}"]
            case ast.If(orelse=[ast.If()]):
                nested = self._statement(node.orelse[0], indent)
                head = self._if(node, indent, deeper)
                return [*head, f"{indent}}} else {nested[0].strip()}", *nested[1:]]
            case ast.If():
                lines = self._if(node, indent, deeper)
                if node.orelse:
                    lines += [f"{indent}}} else {{", *self._block(node.orelse, deeper)]
                return [*lines, f"{indent}}}"]
        raise self.home.law.refused(node)

    def _if(self, node: ast.If, indent: str, deeper: str) -> list[str]:
        head = f"{indent}if ({self._expression(node.test).text}) {{"
        return [head, *self._block(node.body, deeper)]

    def _assignment(self, node: ast.Assign) -> str:
        name = _target(node)
        if not name:
            place = self._expression(node.targets[0])
            return f"{place.text} = {self._as(node.value, place.type)}"
        value = self._as(node.value, self.types[name])
        fresh = name in self.declared.get(id(node), ())
        return f"{self._declare(name) if fresh else name} = {value}"

    # Expressions

    def _as(self, node: ast.expr, kind: str) -> str:
        found = self._expression(node)
        makes_real = kind in ("real", self.home.real) and found.type == "int"
        return self._real(found).text if makes_real else found.text

    def _real(self, found: Expression) -> Expression:
        # A literal becomes 2.0f; (real)2 is the same number, but harder to read.
        if found.text.lstrip("-").isdigit():
            return Expression(number(float(found.text), self.home.single), "real")
        return Expression(f"({self.home.real}){found.within(14)}", "real", 14)

    def _expression(self, node: ast.expr, quiet: bool = False) -> Expression:
        """`quiet`: only the type is wanted, nothing is translated for it."""
        home = self.home
        match node:
            case ast.Constant(value=int()):
                return Expression(str(int(node.value)), "int")  # type: ignore[arg-type]
            case ast.Constant(value=float()):
                return Expression(number(node.value, home.single), "real")  # type: ignore[arg-type]
            # Status codes are enumerators of the header, so C and Python share one list of them.
            case ast.Name(id=name) if name.isupper() and hasattr(_codes, name):
                return Expression(f"{home.stem}_{name}".upper(), "int")
            case ast.Name(id=name) if name not in self.types:
                return self._expression(ast.Constant(home.law.constant(name)))
            case ast.Name(id=name):
                return Expression(name, self.types[name])
            case ast.Attribute(value=ast.Name(id=name)):
                return Expression(f"{name}->{node.attr}", self._field(node))
            case ast.Subscript():
                array, index = (self._expression(e, quiet) for e in (node.value, node.slice))
                if self._is_constant(node.value):
                    return Expression(f"{home.stem.upper()}_AT({array.text}, {index.text})", "real")
                return Expression(f"{array.text}[{index.text}]", "real")
            case ast.UnaryOp():
                sign = "!" if isinstance(node.op, ast.Not) else "-"
                inner = self._expression(node.operand, quiet)
                return Expression(
                    f"{sign}{inner.within(14)}", "int" if sign == "!" else inner.type, 14
                )
            case ast.BinOp():
                return self._binary(node.op, node.left, node.right, quiet)
            case ast.Compare(ops=[op], comparators=[right]):
                found = self._binary(op, node.left, right, quiet)
                return Expression(found.text, "int", found.level)
            case ast.BoolOp():
                sign, level = _OPERATORS[type(node.op)]
                # gcc wants && within || in parentheses, and a choice within either.
                parts = [self._expression(part, quiet).within(9) for part in node.values]
                return Expression(f" {sign} ".join(parts), "int", level)
            case ast.IfExp():
                both = [self._expression(e, quiet) for e in (node.body, node.orelse)]
                kind = "real" if "real" in (both[0].type, both[1].type) else both[0].type
                yes, no = (self._real(e) if kind == "real" != e.type else e for e in both)
                test = self._expression(node.test, quiet).within(4)
                return Expression(f"{test} ? {yes.within(4)} : {no.within(3)}", kind, 3)
            case ast.Call(func=ast.Name(id="int"), args=[inner]):
                return Expression(f"(int){self._expression(inner, quiet).within(15)}", "int", 14)
            case ast.Call(func=ast.Name(id=name)) if name in MATHS:
                given = ", ".join(self._as(a, "real") for a in node.args)
                return Expression(f"{name}{'f' * home.single}({given})", "real")
            case ast.Call(func=ast.Name(id=name)):
                return self._call(node, name, quiet)
        raise self.home.law.refused(node)

    def _binary(self, op: Any, left: ast.expr, right: ast.expr, quiet: bool) -> Expression:
        sign, level = _OPERATORS[type(op)]
        a, b = self._expression(left, quiet), self._expression(right, quiet)
        kind = "int"
        # 1/2 is 0.5 in Python and 0 in C, so both sides of a division become real. // and % of integers
        # round down in Python and towards zero in C; they agree, because indices are not negative.
        if "real" in (a.type, b.type) or isinstance(op, ast.Div):
            kind = "real"
            a, b = (self._real(e) if e.type == "int" else e for e in (a, b))
        # Operators group from the left, a - b - c = (a - b) - c: on the right an equal level needs
        # parentheses. So no sum changes its order, and C rounds where Python does. gcc wants a comparison
        # within another one in parentheses.
        least = 11 if level in (9, 10) else level
        return Expression(f"{a.within(least)} {sign} {b.within(level + 1)}", kind, level)

    def _call(self, node: ast.Call, name: str, quiet: bool) -> Expression:
        if self.kinds.get(name) == "Callable":
            return Expression(
                f"{self.given[name]}({', '.join(self._as(e, '') for e in node.args)})", "real"
            )
        owner = self.home if name in self.home.functions else self.home.borrowed(name)
        return self._called(owner, owner.functions[name], node, quiet)

    def _called(
        self, owner: Element, target: ast.FunctionDef, node: ast.Call, quiet: bool
    ) -> Expression:
        kinds = {a.arg: _kind(a.annotation) for a in target.args.args}
        # Inference asks for types before all are known; translating here would put wrong ones in `done`.
        if quiet:
            return Expression("", _kind(target.returns))
        given, plain = {}, []
        for (argument, kind), value in zip(kinds.items(), node.args, strict=True):
            if kind == "Callable":
                assert isinstance(value, ast.Name)
                given[argument] = self.given.get(value.id) or self._own(value.id)
                continue
            # What is Any belongs to the caller: its parameters, passed on to the function that it gives.
            if kind == "Any":
                assert isinstance(value, ast.Name)
                of_own = f"const {self.home.prefix}_parameters"
                given[argument] = self.given.get(value.id, of_own)
            plain.append(self._as(value, kind))
        called = Function(owner, target, given, self.done).translate()
        return Expression(f"{called}({', '.join(plain)})", _kind(target.returns))

    def _own(self, name: str) -> str:
        return Function(self.home, self.home.functions[name], {}, self.done).translate()


def _kind(annotation: ast.expr | None) -> str:
    text = ast.unparse(annotation) if annotation else "float"
    return "Callable" if text.startswith("Callable") else _KINDS.get(text, text)


def _first(body: list[ast.stmt], name: str) -> ast.stmt:
    """The statement at which a variable is declared: within the smallest block that has all its uses."""
    hits = [node for node in body if name in _names(node)]
    blocks = [getattr(hits[0], part, []) for part in ("body", "orelse")]
    inside = [block for block in blocks if any(name in _names(node) for node in block)]
    heads = [getattr(hits[0], part) for part in ("test", "iter") if hasattr(hits[0], part)]
    if len(hits) == 1 and len(inside) == 1 and not any(name in _names(head) for head in heads):
        return _first(inside[0], name)
    return hits[0]


def _names(node: ast.AST) -> set[str]:
    return {n.id for n in ast.walk(node) if isinstance(n, ast.Name)}


def _target(node: ast.stmt) -> str:
    """The variable that a statement sets, if it does."""
    match node:
        case ast.Assign(targets=[ast.Name(id=name)]):
            return name
    return ""
