"""A law as a function of addresses: the same statements, with numbers loaded from m and n.

    y = s.u + p.weights[k] * x    becomes    y = get(_m, ...) + get(_m, whole(_n, _b + 3) + k) * x

`get(m, i)`, `put(m, i, x)` and `whole(n, i)` are loads and stores without more: numba compiles functions of
plain numbers several times as fast as those of arrays. Only what the laws need is known here.
"""

import ast
from collections.abc import Sequence

from ._law import MATHS, Law, law


class Translation:
    """The texts of the functions that were asked for, after those that they call."""

    def __init__(self) -> None:
        self.texts: dict[str, str] = {}

    def values(self, kind: str, name: str, given: dict[str, str] | None = None) -> str:
        """A function's name in the text. `given`: names of the functions that it takes."""
        made = Function(self, law(kind), name, given or {})
        if made.title not in self.texts:
            self.texts[made.title] = ""  # called by itself, it would be made again
            text = made.text()
            del self.texts[made.title]
            self.texts[made.title] = text
        return made.title


class Function:
    """One function of a law. Locals are whole numbers, unless a real or an array is assigned to them."""

    def __init__(self, home: Translation, of: Law, name: str, given: dict[str, str] | None = None):
        self.home, self.of, self.node = home, of, of.functions[name]
        self.given = given or {}
        self.title = "_".join([of.kind, name, *self.given.values()])
        self.arguments = [a.arg for a in self.node.args.args]
        self.kinds = {a.arg: _kind(a.annotation) for a in self.node.args.args}
        self.returns = _kind(self.node.returns)
        sets = [
            (n.targets[0].id, n.value)
            for n in ast.walk(self.node)
            if isinstance(n, ast.Assign) and isinstance(n.targets[0], ast.Name)
        ]
        sets = [(name, value) for name, value in sets if name not in self.arguments]
        self.kinds |= {name: "int" for name, _ in sets}
        self.kinds |= {
            n.target.id: "int" for n in ast.walk(self.node)
            if isinstance(n, ast.For) and isinstance(n.target, ast.Name)
        }  # fmt: skip
        # A variable may take its kind from one that is assigned further down, through a chain of three.
        for name, value in sets * 3:
            kind = self.kind(value)
            self.kinds[name] = kind if self.kinds[name] != "float" else "float"

    def kind(self, e: ast.expr) -> str:
        """ "int", "float" or "Reals"."""
        match e:
            case ast.Constant(value=v):
                return "float" if isinstance(v, float) else "int"
            case ast.Name(id=x):
                return self.kinds.get(x, type(self.of.constant(x) or 0).__name__)
            case ast.Attribute(value=ast.Name(id=x), attr=f):
                return self.of.fields[self.kinds[x]][f]
            case ast.Subscript():
                return "float"
            case ast.BinOp(left=a, op=op, right=b):
                both = self.kind(a), self.kind(b)
                return "float" if isinstance(op, ast.Div) or "float" in both else "int"
            case ast.UnaryOp(op=ast.USub(), operand=a):
                return self.kind(a)
            case ast.IfExp(body=a, orelse=b):
                return "float" if "float" in (self.kind(a), self.kind(b)) else self.kind(a)
            case ast.Call(func=ast.Name(id=g)):
                if g == "int":
                    return "int"
                owner = self.called(g)
                return _kind(owner.functions[g].returns) if owner else "float"
        return "int"

    def called(self, name: str) -> Law | None:
        """Where a called function stands; None of mathematics and of what is given."""
        return None if name in self.given or name in MATHS else self.of.owner(name)

    # Text

    def text(self) -> str:
        return "\n".join(["@njit", self.head(), *self.block(self.body(), 1)])

    def head(self, suffix: str = "", tape: str = "") -> str:
        names = ["_m", "_n", *([tape] if tape else []), *self._taken()]
        return f"def {self.title}{suffix}({', '.join(names)}):"

    def _taken(self) -> list[str]:
        """Its structures are one argument, where their law's row begins; what it looks at as a whole, and
        functions, are none."""
        structures = [x for x in self.arguments if self.kinds[x] in ("Parameters", "State", "Any")]
        taken = [x for x in self.arguments if x not in structures and self.kinds[x] != "Callable"]
        return [*(["_b"] if set(structures) - {"whole"} else []), *taken]

    def body(self) -> list[ast.stmt]:
        return self.node.body[bool(ast.get_docstring(self.node)) :]

    def block(self, body: list[ast.stmt], depth: int, leave: str = "return") -> list[str]:
        """`leave`: "break" where a return ends a loop that settles."""
        i, lines = "    " * depth, []
        for node in body:
            match node:
                case ast.Assign(targets=[target], value=e):
                    lines.append(i + self.put(target, self.value(e)))
                case ast.Return() if leave == "break":
                    lines.append(f"{i}break")
                case ast.Return(value=e):
                    lines.append(f"{i}return {self.value(e) if e else ''}".rstrip())
                case ast.Expr(value=e):
                    lines.append(f"{i}{self.value(e)}")
                case ast.If(test=t, body=a, orelse=b):
                    lines += [f"{i}if {self.truth(t)}:", *self.block(a, depth + 1, leave)]
                    if b:
                        lines += [f"{i}else:", *self.block(b, depth + 1, leave)]
                case ast.While(test=t, body=a):
                    lines += [f"{i}while {self.truth(t)}:", *self.block(a, depth + 1, leave)]
                case ast.For(target=ast.Name(id=k), iter=it, body=a):
                    lines += [f"{i}for {k} in {self.value(it)}:", *self.block(a, depth + 1, leave)]
                case _:
                    raise self.of.refused(node)
        return lines

    def put(self, target: ast.expr, value: str) -> str:
        if isinstance(target, ast.Name):
            return f"{target.id} = {value}"
        return f"put(_m, {self.address(target)}, {value})"

    def address(self, e: ast.expr) -> str:
        """Where a number of a structure, or an array, is in m."""
        match e:
            case ast.Attribute(value=ast.Name(id=x), attr=f):
                structure = self.kinds[x]
                place = self.of.place(structure, f)
                if self.kind(e) == "Reals":
                    return f"whole(_n, _b + {place})"
                return f"whole(_n, _b + {int(structure == 'State')}) + {place}"
            case ast.Subscript(value=array, slice=k):
                begin = array.id if isinstance(array, ast.Name) else self.address(array)
                return f"{begin} + {self.value(k)}"
        raise self.of.refused(e)

    def value(self, e: ast.expr) -> str:
        match e:
            case ast.Constant():
                return repr(e.value)
            case ast.Name(id=x):
                known = self.of.constant(x)
                return x if x in self.kinds or known is None else repr(known)
            case ast.Attribute(value=ast.Name(id=x), attr=f):
                kind = self.kind(e)
                if kind == "Reals":
                    return self.address(e)
                if kind == "int" and self.kinds[x] == "Parameters":
                    return f"whole(_n, _b + {self.of.place('Parameters', f)})"
                loaded = f"get(_m, {self.address(e)})"
                return f"int({loaded})" if kind == "int" else loaded
            case ast.Subscript():
                return f"get(_m, {self.address(e)})"
            case ast.UnaryOp(op=ast.Not(), operand=a):
                return f"(not {self.truth(a)})"
            case ast.UnaryOp(operand=a):
                return f"(-{self.value(a)})"
            case ast.BinOp(left=a, op=op, right=b):
                return f"({self.value(a)}{_sign(ast.BinOp(_A, op, _B))}{self.value(b)})"
            case ast.Compare(left=a, ops=[op], comparators=[b]):
                return f"({self.value(a)}{_sign(ast.Compare(_A, [op], [_B]))}{self.value(b)})"
            case ast.BoolOp(op=op, values=parts):
                word = " and " if isinstance(op, ast.And) else " or "
                return f"({word.join(map(self.truth, parts))})"
            case ast.IfExp(test=t, body=a, orelse=b):
                return f"({self.value(a)} if {self.truth(t)} else {self.value(b)})"
            case ast.Call(func=ast.Name(id=g), args=args):
                if g in ("int", "range") or (g in MATHS and g not in self.of.functions):
                    return f"{g}({', '.join(map(self.value, args))})"
                return f"{self.callee(g, args)}({', '.join(['_m', '_n', *self.passed(args)])})"
        raise self.of.refused(e)

    def truth(self, e: ast.expr) -> str:
        """A condition. numba's `and` has no kind for a whole number beside a truth value."""
        made = isinstance(e, ast.Compare | ast.BoolOp)
        made = made or (isinstance(e, ast.UnaryOp) and isinstance(e.op, ast.Not))
        return self.value(e) if made else f"({self.value(e)} != 0)"

    def callee(self, name: str, args: Sequence[ast.expr]) -> str:
        """The name of a called function, whose text is made. One that takes functions is made for each that
        it is called with."""
        if name in self.given:
            return self.given[name]
        owner = self.called(name)
        assert owner is not None, name
        takes = Function(self.home, owner, name) if owner.functions[name] is not self.node else self
        given = {
            argument: self.given.get(a.id) or self.home.values(self.of.kind, a.id)
            for argument, a in zip(takes.arguments, args, strict=True)
            if takes.kinds[argument] == "Callable" and isinstance(a, ast.Name)
        }
        return self.home.values(owner.kind, name, given)

    def passed(self, args: Sequence[ast.expr]) -> list[str]:
        """What a call passes on, as `_taken` says."""
        names: list[str] = []
        for a in args:
            name = a.id if isinstance(a, ast.Name) else ""
            kind = self.kinds.get(name, "")
            if kind in ("Parameters", "State") or (kind == "Any" and name != "whole"):
                names += [] if "_b" in names else ["_b"]
            elif kind not in ("Any", "Callable") and name not in self.of.functions:
                names.append(self.value(a))
        return names


_A, _B = ast.Name("a"), ast.Name("b")


def _sign(e: ast.expr) -> str:
    return ast.unparse(e)[1:-1]


def _kind(annotation: ast.expr | None) -> str:
    text = ast.unparse(annotation) if annotation else "float"
    return "Callable" if text.startswith("Callable") else text
