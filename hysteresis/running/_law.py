"""A law file, parsed: the fields of its structures, its functions, and where its numbers lie.

All floats of a tree of laws lie in one vector m: first the parameters of every law, then the states. All
integers lie in one vector n, in which every law has a row, from `b` on:

    n[b]         where in m its float parameters begin
    n[b + 1]     where in m the numbers of its state begin that are no arrays, integers among them
    n[b + 2] ... its integer parameters, then where its arrays begin: of the parameters, of the state

So what is compiled of a law does not depend on how many plays, branches or cells there are.
"""

import ast
import inspect
import io
import tokenize
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from threading import RLock
from types import ModuleType
from typing import Any, TypeVar

from .. import laws
from .._errors import InputError
from ..laws import announced, module_of

HEAD = 2

MATHS = (
    "asinh", "cosh", "exp", "expm1", "fabs", "log", "log1p", "pow", "sinh", "sqrt", "tanh",
)  # fmt: skip
SIGNS = (
    ast.Add, ast.Sub, ast.Mult, ast.Div, ast.FloorDiv, ast.Mod, ast.USub, ast.Not, ast.And, ast.Or,
    ast.Lt, ast.LtE, ast.Gt, ast.GtE, ast.Eq, ast.NotEq,
)  # fmt: skip
"""What a law may call of `math`, and its signs: each has a translation to all languages."""

PARSING = RLock()
"""Held while a syntax tree is made or compiled: CPython 3.11 fails where two threads do so at once."""


Made = TypeVar("Made", bound=Callable[..., Any])


@dataclass
class Law:
    """`fields`: of Parameters and State, name to "int", "float" or "Reals". `comments`: by their lines.
    `bounds`: how often loops turn. `settles`: the lines of loops that end in a root, by a comment
    "settles"; `vanishes`: those of quotients that are 0 there."""

    kind: str
    module: ModuleType
    fields: dict[str, dict[str, str]] = field(default_factory=dict)
    functions: dict[str, ast.FunctionDef] = field(default_factory=dict)
    comments: dict[int, tokenize.TokenInfo] = field(default_factory=dict)

    def __post_init__(self) -> None:
        source = inspect.getsource(self.module)
        for node in ast.parse(source).body:
            if isinstance(node, ast.FunctionDef):
                self.functions[node.name] = node
            elif isinstance(node, ast.ImportFrom) and node.level:
                # What is taken over from another law is about this one's numbers.
                own = [a.name for a in node.names if a.asname and not a.name.isupper()]
                self.functions |= {x: law(str(node.module)).functions[x] for x in own}
            elif isinstance(node, ast.ClassDef):
                fields = [a for a in node.body if isinstance(a, ast.AnnAssign)]
                self.fields[node.name] = {
                    ast.unparse(a.target): ast.unparse(a.annotation) for a in fields
                }
                for a in fields:
                    if ast.unparse(a.annotation) not in ("int", "float", "Reals"):
                        raise self.refused(a)
        tokens = tokenize.generate_tokens(io.StringIO(source).readline)
        self.comments = {t.start[0]: t for t in tokens if t.type == tokenize.COMMENT}
        self.bounds = {k: t.string.partition("at most: ")[2] for k, t in self.comments.items()}
        self.settles, self.vanishes = (
            {line for line, t in self.comments.items() if t.string == f"# {word}"}
            for word in ("settles", "vanishes")
        )
        for node in self.functions.values():
            if getattr(self.module, node.name).__module__ == self.module.__name__:
                self._check(node)

    def refused(self, node: ast.stmt | ast.expr) -> InputError:
        """What is raised for something that has no translation."""
        text = ast.unparse(node).partition("\n")[0]
        return InputError(
            "untranslatable-law",
            f"{text!r} of the law {self.kind} cannot be translated.",
            place=f"{self.module.__file__}:{node.lineno}",
            cause="a law uses only what all languages have that it is translated to.",
            fix="use arguments with types, their numbers and arrays (float, int, Reals), arithmetic,"
            " comparisons, if, for over a range, while with a comment `at most:`, functions of laws, and"
            f" {', '.join(MATHS)} of math.",
        )

    def _check(self, function: ast.FunctionDef) -> None:
        """Refuse what no translation knows; the same for all of them, so that an error comes at once."""
        kinds = {a.arg: a.annotation and ast.unparse(a.annotation) for a in function.args.args}
        body = function.body[bool(ast.get_docstring(function)) :]
        nodes = [n for statement in body for n in ast.walk(statement)]
        names = {n.id for n in nodes if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)}
        names |= {*kinds, *self.functions, "int", "range"}
        names |= {x for x in MATHS if hasattr(self.module, x)}
        for node in (n for n in nodes if isinstance(n, ast.stmt | ast.expr)):
            match node:
                case (
                    ast.Assign(targets=[ast.Name() | ast.Attribute() | ast.Subscript()])
                    | ast.Expr(value=ast.Call()) | ast.Return() | ast.If() | ast.IfExp() | ast.Subscript()
                    | ast.For(target=ast.Name(), iter=ast.Call(args=[_] | [_, _]), orelse=[])
                    | ast.Call(func=ast.Name(), keywords=[])
                ):  # fmt: skip
                    known = True
                case ast.Constant(value=int() | float() as value):
                    known = abs(value) < float("inf")
                case (
                    ast.BinOp(op=op) | ast.UnaryOp(op=op) | ast.BoolOp(op=op) | ast.Compare(ops=[op])
                ):  # fmt: skip
                    known = isinstance(op, SIGNS)
                case ast.Attribute(value=ast.Name(id=x), attr=of, ctx=ctx):
                    kind = kinds.get(x) or ""
                    known = of in self.fields.get(kind, ())
                    known = known and (kind == "State" or isinstance(ctx, ast.Load))
                case ast.While(orelse=[]):
                    known = bool(self.bounds.get(node.lineno))
                case ast.Name(id=x):
                    known = x in names or self.constant(x) is not None or self.owner(x) is not None
                case _:
                    known = False
            if not known:
                raise self.refused(node)

    def named(self, structure: str, *kinds: str) -> list[str]:
        """The fields of these kinds, in their order."""
        return [name for name, kind in self.fields[structure].items() if kind in kinds]

    def place(self, structure: str, name: str) -> int:
        """Of a number: after where its structure's begin in m. Of an integer parameter, and of where an
        array begins: after b in n."""
        kind = self.fields[structure][name]
        if structure == "State" and kind != "Reals":
            return self.named("State", "int", "float").index(name)
        if kind == "float":
            return self.named("Parameters", "float").index(name)
        whole = [*self.named("Parameters", "int"), *self.named("Parameters", "Reals")]
        if structure == "State":
            return HEAD + len(whole) + self.named("State", "Reals").index(name)
        return HEAD + whole.index(name)

    @property
    def row(self) -> int:
        """Length of its row in n."""
        own = self.named("Parameters", "int", "Reals")
        return HEAD + len(own) + len(self.named("State", "Reals"))

    def takes_time(self, function: str) -> bool:
        """Whether a function has dt."""
        return any(a.arg == "dt" for a in self.functions[function].args.args)

    def constant(self, name: str) -> int | float | None:
        """A number of the file, by its name."""
        found = getattr(self.module, name, None)
        return found if isinstance(found, int | float) else None

    def owner(self, name: str) -> "Law | None":
        """The law, or the file of helpers, in which a function stands that is called by this name."""
        if name in self.functions:
            return self
        module = inspect.getmodule(getattr(self.module, name, None))
        kind = module.__name__.rpartition(".")[2] if module else ""
        is_law = kind in announced() or (module and module.__package__ == laws.__name__)
        return law(kind) if is_law else None


def kept(function: Made) -> Made:
    """A function whose results are kept until a law is announced again."""
    made: Any = cache(function)
    laws.FORGET.append(made.cache_clear)
    return made


@kept
def law(kind: str) -> Law:
    """By the name of its file."""
    with PARSING:
        return Law(kind, module_of(kind))
