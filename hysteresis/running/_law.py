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
import math
import tokenize
from dataclasses import dataclass, field
from functools import cache
from threading import RLock
from types import ModuleType

from ..laws import module_of

HEAD = 2

PARSING = RLock()
"""Held while a syntax tree is made or compiled: CPython 3.11 fails where two threads do so at once."""


@dataclass
class Law:
    """`fields`: of Parameters and State, name to "int", "float" or "Reals". `comments`: by their lines.
    `settles`: the lines of loops that end in a root, by a comment "settles"; `vanishes`: those of quotients
    that are 0 there."""

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
                self.fields[node.name] = {
                    a.target.id: ast.unparse(a.annotation)
                    for a in node.body
                    if isinstance(a, ast.AnnAssign) and isinstance(a.target, ast.Name)
                }
        tokens = tokenize.generate_tokens(io.StringIO(source).readline)
        self.comments = {t.start[0]: t for t in tokens if t.type == tokenize.COMMENT}
        self.settles, self.vanishes = (
            {line for line, t in self.comments.items() if t.string == f"# {word}"}
            for word in ("settles", "vanishes")
        )

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

    def owner(self, name: str) -> "Law | None":
        """The law, or the file of helpers, in which a function stands that is called by this name."""
        if name in self.functions:
            return self
        module = inspect.getmodule(getattr(self.module, name, None))
        if module is None or module is math:
            return None
        return law(module.__name__.rpartition(".")[2])


@cache
def law(kind: str) -> Law:
    """By the name of its file."""
    with PARSING:
        return Law(kind, module_of(kind))
