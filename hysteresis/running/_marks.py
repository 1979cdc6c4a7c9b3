"""A law with its derivatives: the same statements, with a mark after every assignment of a real.

    x = a * v    becomes    x = a * v; mark2(_t, #x, #a, v, #v, a)       dx = v da + a dv

A mark says which real became something (its number), and by which factors it now depends on which others.
What becomes of it is not decided here: `_memory.py` adds up tangents at once. Numbers of locals come first,
then those of m: LOCALS + address.

A real has a number only where it can depend on something that is asked for: `constant` parameters and what
is made of them have none. A loop with the comment "settles" finds a root by Newton's method. It runs
without marks, and then its body once more with them: the derivative of a root is that of one step from
there, because a step there changes nothing else (implicit function theorem). What a step is divided by does
not matter there: such a quotient has the comment "vanishes". A real that nothing depends on has no marks.
"""

import ast
from collections.abc import Set

from ._law import MATHS, Law, law
from ._values import Function, Translation

PARTIALS = {  # of f at a, where v is f(a)
    "exp": "{v}", "log": "1.0 / {a}", "sqrt": "0.5 / {v}", "fabs": "(1.0 if {a} > 0.0 else -1.0)",
    "tanh": "(1.0 - {v} * {v})", "expm1": "({v} + 1.0)", "log1p": "1.0 / (1.0 + {a})",
    "asinh": "1.0 / sqrt({a} * {a} + 1.0)", "sinh": "cosh({a})", "cosh": "sinh({a})",
}  # fmt: skip

Key = tuple[str, str]
"""A real: its function and its name; or its law and its structure and field."""
Leaf = tuple[str, str]
"""The number of a real, and the derivative by it."""
ARRAY: Key = ("", "array")
"""Of an array that has a name in a function."""
ROUNDS = 24
"""In which it is found what depends on what; a law needs ten."""


class Marked(Translation):
    """Texts with marks. `constant`: (law, field) of the parameters without derivatives."""

    def __init__(self, constant: Set[Key] = frozenset()):
        super().__init__()
        self.constant, self.root = constant, ""
        self.numbers: dict[Key, int] = {}
        self.active: set[Key] = set()
        self.changed = False
        # Reals that others depend on: all of them may, until it is known what is active.
        self.used: set[Key | str] | None = None
        self.using: set[Key | str] = set()
        self.copies: dict[Key, bool] = {}
        self.copied = False
        self.fresh: dict[str, str] = {}
        # An argument that is at every call the same argument of the caller has the caller's number.
        self.sources: dict[Key, set[Key | None]] = {}
        self.same: dict[Key, Key] = {}

    def number(self, function: str, name: str) -> int:
        return self.numbers.setdefault(self.origin((function, name)), len(self.numbers))

    def origin(self, key: Key) -> Key:
        while key in self.same:
            key = self.same[key]
        return key

    def marked(self, kind: str, name: str) -> str:
        """The name of a function's text with marks; what is active in it is found by going over it until
        nothing changes."""
        self.root = f"{kind}_{name}"
        title = f"{self.root}_r"
        if title in self.texts:
            return title
        given = {a.arg for a in law(kind).functions[name].args.args} - {"dt"}
        self.active |= {(self.root, x) for x in given}
        self.used, self.copied = None, False
        for _ in range(ROUNDS):
            self.changed, self.fresh, self.sources = False, {}, {}
            self.copies = self.copies if self.copied else {}
            self.using = {str(self.number(self.root, "return"))}
            _Recording(self, law(kind), name).add()
            found = {k: one for k, (one, *more) in self.sources.items() if one and not more}
            if not found.items() <= self.same.items():
                self.same |= found
                self.changed = True
            if not self.changed and (not self.copied or self.used != self.using):
                self.used = self.using if self.copied else None
                self.copied = True
                continue
            if not self.changed:
                self.texts.update(self.fresh)
                return title
        raise RuntimeError(f"what depends on what in {title} does not settle")


class _Recording(Function):
    """One function of a law, with its marks."""

    home: Marked

    def __init__(self, home: Marked, of: Law, name: str):
        super().__init__(home, of, name)
        # Of reals in m, and of locals, by their numbers.
        self.names: dict[str, Key] = {}
        self.locals: dict[str, Key] = {}
        self.vanishing = False
        self.moved = self.written()
        # Which numbers the arguments of a helper have depends on who calls it: each law has its own.
        if self.title != home.root:
            self.title = f"{home.root}__{self.title}"

    def add(self) -> str:
        """Its text among the fresh ones, after those that it calls; its name."""
        name = f"{self.title}_r"
        if name not in self.home.fresh:
            self.home.fresh[name] = ""
            self.temporaries = 0
            text = "\n".join(["@njit", self.head("_r", "_t"), *self.block(self.body(), 1)])
            del self.home.fresh[name]
            self.home.fresh[name] = text
        return name

    def block(self, body: list[ast.stmt], depth: int, leave: str = "return") -> list[str]:
        i, lines = "    " * depth, []
        for node in body:
            match node:
                case ast.Assign(targets=[target], value=e):
                    self.vanishing = node.lineno in self.of.vanishes
                    lines += self.assign(target, e, depth)
                    self.vanishing = False
                case ast.Return(value=ast.expr() as e):
                    lines += self.give(e, depth)
                case ast.Expr(value=ast.Call(func=ast.Name(id=g), args=args)):
                    before: list[str] = []
                    called, _ = self.recorded_call(g, args, before)
                    lines += [i + x for x in [*before, called]]
                case ast.For() if node.lineno in self.of.settles:
                    plain = Function(self.home, self.of, self.node.name)
                    head = f"{i}for {ast.unparse(node.target)} in {self.value(node.iter)}:"
                    lines += [head, *plain.block(node.body, depth + 1, "break")]
                    lines += self.block(node.body, depth)
                case _:
                    lines += super().block([node], depth)
        return lines

    def assign(self, target: ast.expr, e: ast.expr, depth: int) -> list[str]:
        i = "    " * depth
        if self.kind(target) != "float":
            return [i + self.put(target, self.value(e))]
        if isinstance(e, ast.IfExp):
            one, other = (self.assign(target, x, depth + 1) for x in (e.body, e.orelse))
            return [f"{i}if {self.truth(e.test)}:", *one, f"{i}else:", *other]
        before: list[str] = []
        text, leaves = self.whole(e, before)
        key, number = self.real(target)
        if isinstance(target, ast.Name) and self.is_copy(key, leaves):
            ((other, _),) = leaves
            self.home.using.add(self.names.get(other, other))
            return [i + x for x in [*before, f"{number} = {other}", self.put(target, text)]]
        # The partial derivatives are those at the old values: they are taken before the new one is there.
        mark = self.mark(key, number, leaves)
        if leaves and mark:
            return [i + x for x in [*before, f"_x = {text}", *mark, self.put(target, "_x")]]
        return [i + x for x in [*before, self.put(target, text), *mark]]

    def give(self, e: ast.expr, depth: int) -> list[str]:
        i = "    " * depth
        if self.returns != "float":
            return [f"{i}return {self.value(e)}"]
        if isinstance(e, ast.IfExp):
            one, other = (self.give(x, depth + 1) for x in (e.body, e.orelse))
            return [f"{i}if {self.truth(e.test)}:", *one, f"{i}else:", *other]
        before: list[str] = []
        text, leaves = self.whole(e, before)
        number = str(self.home.number(self.title, "return"))
        mark = self.mark((self.title, "return"), number, leaves)
        return [i + x for x in [*before, f"_y = {text}", *mark, "return _y"]]

    def mark(self, key: Key, number: str, leaves: list[Leaf]) -> list[str]:
        if leaves and key not in self.home.active:
            self.home.active.add(key)
            self.home.changed = True
        if key not in self.home.active or not self.is_used(key, number):
            return []
        self.home.using |= {self.names.get(x, x) for x, _ in leaves if x != number}
        # Of an array of parameters each one mostly is a direction of its own.
        spots = [leaf for leaf in leaves if self.is_spot(leaf[0])]
        others = [leaf for leaf in leaves if leaf not in spots]
        given = "".join(f", {other}, {by}" for other, by in others)
        same = others == [(number, "1.0")]
        lines = [] if same else [f"mark{len(others)}(_t, {number}{given})"]
        return [*lines, *(f"spot(_t, {number}, {other}, {by})" for other, by in spots)]

    def is_spot(self, number: str) -> bool:
        structure, _, name = self.names.get(number, ARRAY)[1].partition(".")
        return structure == "Parameters" and self.of.fields[structure][name] == "Reals"

    def written(self) -> set[Key] | None:
        """What the function changes; None where it calls others that may change anything."""
        found: set[Key] = set()
        for n in ast.walk(self.node):
            if isinstance(n, ast.Call) and isinstance(n.func, ast.Name):
                owner = self.called(n.func.id)
                if owner and Function(self.home, owner, n.func.id).returns != "int":
                    return None
            if isinstance(n, ast.Assign):
                (target,) = n.targets
                base = target.value if isinstance(target, ast.Subscript) else target
                if isinstance(base, ast.Name):
                    found.add((self.title, base.id) if base is target else ARRAY)
                else:
                    found.add(self.real(base)[0])
        return found

    def is_copy(self, key: Key, leaves: list[Leaf]) -> bool:
        """Whether a local is at every assignment that of another real, which stays: it needs no tangents of
        its own, only the number of those."""
        if self.home.copies.get(key, True):
            number = leaves[0][0] if len(leaves) == 1 else ""
            other = self.names.get(number) or self.locals.get(number, ARRAY)
            own = self.moved is not None and other != ARRAY and other not in self.moved
            self.home.copies[key] = own and leaves[0][1] == "1.0"
        return self.home.copied and self.home.copies[key]

    def is_used(self, key: Key, number: str) -> bool:
        """Whether anything may depend on a real: a local is known by its number, one of the state by its
        key. An array has more than one name."""
        known = number if number.isdecimal() else key
        name = key[1].removeprefix("State.")
        is_array = key == ARRAY or self.of.fields.get("State", {}).get(name) == "Reals"
        return self.home.used is None or is_array or known in self.home.used

    def real(self, e: ast.expr) -> tuple[Key, str]:
        """The key and the number of a real variable, or of one in m."""
        if isinstance(e, ast.Name):
            key = self.title, e.id
            if self.home.copied and self.home.copies.get(key):
                return key, f"_n_{e.id}"
            number = str(self.home.number(*key))
            self.locals[number] = key
            return key, number
        base = e.value if isinstance(e, ast.Subscript) else e
        number = f"LOCALS + {self.address(e)}"
        if isinstance(base, ast.Name):  # an array that has a name here, of whatever structure
            return ARRAY, number
        assert isinstance(base, ast.Attribute)
        assert isinstance(base.value, ast.Name)
        key = self.of.kind, f"{self.kinds[base.value.id]}.{base.attr}"
        self.names[number] = key
        return key, number

    def is_active(self, key: Key) -> bool:
        structure, _, name = key[1].partition(".")
        if structure == "Parameters":
            return (key[0], name) not in self.home.constant
        return structure in ("array", "State") or key in self.home.active

    def whole(self, e: ast.expr, before: list[str]) -> tuple[str, list[Leaf]]:
        """As `both`; a call alone needs no number of its own beside that which it returns on."""
        if isinstance(e, ast.Call) and isinstance(e.func, ast.Name) and self.called(e.func.id):
            called, returned = self.recorded_call(e.func.id, e.args, before)
            return called, [(x, "1.0") for x in returned]
        return self.both(e, before)

    def both(self, e: ast.expr, before: list[str]) -> tuple[str, list[Leaf]]:
        """The value, and its derivatives; calls and choices are taken out, into lines `before`."""
        if self.kind(e) != "float" or isinstance(e, ast.Constant):
            return self.value(e), []
        match e:
            case ast.Name(id=x) if x not in self.kinds:
                return self.value(e), []
            case ast.Name() | ast.Attribute() | ast.Subscript():
                key, number = self.real(e)
                return self.value(e), [(number, "1.0")] if self.is_active(key) else []
            case ast.UnaryOp(operand=a):
                x, dx = self.both(a, before)
                return f"(-{x})", _times("-1.0", dx)
            case ast.BinOp(left=a, op=op, right=b):
                (x, dx), (y, dy) = self.both(a, before), self.both(b, before)
                match op:
                    case ast.Add():
                        return f"({x} + {y})", _sum(dx, dy)
                    case ast.Sub():
                        return f"({x} - {y})", _sum(dx, _times("-1.0", dy))
                    case ast.Mult():
                        return f"({x} * {y})", _sum(_times(y, dx), _times(x, dy))
                    case ast.Div():
                        rest = [] if self.vanishing else _times(f"(-{x} / ({y} * {y}))", dy)
                        return f"({x} / {y})", _sum(_times(f"(1.0 / {y})", dx), rest)
            case ast.IfExp():
                name = self.temporary("if")
                self.kinds[name] = "float"
                before += self.assign(ast.Name(name), e, 0)
                return self.both(ast.Name(name), before)
            case ast.Call(func=ast.Name(id=g), args=args) if g in MATHS:
                return self.mathematics(g, args, before)
            case ast.Call(func=ast.Name(id=g), args=args):
                called, returned = self.recorded_call(g, args, before)
                # The next call may return on the same number.
                name = self.temporary("of")
                before.append(f"{name} = {called}")
                number = str(self.home.number(self.title, name))
                leaves = [(x, "1.0") for x in returned]
                before += self.mark((self.title, name), number, leaves) if leaves else []
                return name, [(number, "1.0")] if leaves else []
        raise self.of.refused(e)

    def temporary(self, name: str) -> str:
        self.temporaries += 1
        return f"_{name}{self.temporaries}"

    def mathematics(
        self, g: str, args: list[ast.expr], before: list[str]
    ) -> tuple[str, list[Leaf]]:
        (x, dx), *more = [self.both(a, before) for a in args]
        v = self.temporary("f")
        if not more:
            before.append(f"{v} = {g}({x})")
            return v, _times(f"({PARTIALS[g].format(v=v, a=x)})", dx)
        ((y, dy),) = more
        before.append(f"{v} = pow({x}, {y})")
        return v, _sum(_times(f"({y} * {v} / {x})", dx), _times(f"({v} * log({x}))", dy))

    def recorded_call(
        self, g: str, args: list[ast.expr], before: list[str]
    ) -> tuple[str, list[str]]:
        """A call of the text with marks; the number of what it returns where that is active."""
        owner = self.called(g)
        if owner is None:  # functions given to functions have no marks
            raise self.of.refused(self.node)
        twin = type(self)(self.home, owner, g)
        passed: list[str] = []
        for parameter, a in zip(twin.arguments, args, strict=True):
            if twin.kinds[parameter] != "float":
                passed += [x for x in self.passed([a]) if x != "_b" or "_b" not in passed]
                continue
            text, leaves = self.both(a, before)
            passed.append(text)
            key = (twin.title, parameter)
            origin = None
            if isinstance(a, ast.Name) and self.stays(a.id) and twin.stays(parameter):
                origin = self.home.origin((self.title, a.id))
            self.home.sources.setdefault(key, set()).add(origin)
            if key not in self.home.same:
                before += self.mark(key, str(self.home.number(*key)), leaves)
            elif leaves:
                self.home.active.add(key)
        name, key = twin.add(), (twin.title, "return")
        returned = [str(self.home.number(*key))] if key in self.home.active else []
        return f"{name}({', '.join(['_m', '_n', '_t', *passed])})", returned

    def stays(self, name: str) -> bool:
        """Whether it is an argument that is never assigned to."""
        targets = [n.targets[0] for n in ast.walk(self.node) if isinstance(n, ast.Assign)]
        return name in self.arguments and name not in {
            t.id for t in targets if isinstance(t, ast.Name)
        }


def _times(factor: str, leaves: list[Leaf]) -> list[Leaf]:
    return [(x, f"1.0 * {factor}" if d == "1.0" else f"{d} * {factor}") for x, d in leaves]


def _sum(*parts: list[Leaf]) -> list[Leaf]:
    """Derivatives by the same real are added."""
    found: dict[str, str] = {}
    for x, d in (leaf for part in parts for leaf in part):
        found[x] = f"({found[x]} + {d})" if x in found else d
    return list(found.items())
