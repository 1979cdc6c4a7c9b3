"""A tree of laws, run in plain Python."""

import inspect
from collections.abc import Callable, Iterator
from functools import partial
from math import nan
from typing import Any, NamedTuple, get_type_hints

from . import KINDS, announced, module_of
from ._codes import OK
from ._types import check_fields

Function = Callable[[float, float], float]
Tree = dict[str, Any]


def error_of(tree: Tree) -> Callable[[float, float], float]:
    """The standard deviation of an estimate, (dt, value), with a state of its own."""
    element: Any = module_of("error")
    p = _made(element.Parameters, element.ANY_MOTION | tree["parameters"])
    s = _made(element.State, element.UNMOVED | tree["state"])
    return partial(element.deviation, p, s)


class Guard(NamedTuple):
    """The guard of a file, with its own state: (value, status, clipped, apart, reading) to what is
    given out."""

    limited: Callable[[float, int, bool, float, float], float]
    state: Any
    as_nan: bool

    def of(
        self, value: float, status: int, clipped: bool, apart: float, reading: float
    ) -> tuple[float, int]:
        """The estimate as it is given out, and its status."""
        value = self.limited(value, status, clipped, apart, reading)
        return (nan if self.as_nan and self.state.beyond else value), self.state.status


def guard_of(tree: Tree) -> Guard:
    """The guard of a file, see `hysteresis/laws/guard.py`."""
    element: Any = module_of("guard")
    p, s = _made(element.Parameters, tree["parameters"]), _made(element.State, tree["state"])
    return Guard(partial(element.limited, p, s), s, tree["beyond"] == "nan")


class Node(NamedTuple):
    """`look`, `move`, `find` of (dt, value), as of an element; the last one's `status()`.

    `learner`: element, parameters and state of a node that learns. `follow`: of an element that has it.
    """

    look: Function
    move: Function
    find: Function
    status: Callable[[], int]
    learner: tuple[Any, Any, Any] | None = None
    follow: Function | None = None


FOR_EVER = 1e30


def node_of(
    tree: Tree, states: list[Any] | None = None, takes: list[Callable[[float], float]] | None = None
) -> Node:
    """The functions of a tree, with states of its own, which are appended to `states`.

    `takes`: to which is appended whatever takes the condition before a reading.
    """
    kind = tree["kind"]
    inner = [node_of(part, states, takes) for part in parts_of(tree)]
    if kind not in (*KINDS, *announced()):
        raise ValueError(f"no element {kind!r}")
    if kind == "series":
        return _series(inner)
    element: Any = module_of(kind)
    p, s = _made(element.Parameters, tree["parameters"]), _made(element.State, tree["state"])
    if states is not None:
        states.append(s)
    if kind == "share":
        if takes is not None:
            takes.append(partial(element.take, p, s))
        return _share(element, s, inner)
    made = {"scaled": _scaled, "sum": _sum, "adaptive": _adaptive}
    if kind in made:
        return made[kind](element, p, s, inner)
    look, move, find = (_bound(getattr(element, name, None), p, s) for name in Node._fields[:3])
    follow = _bound(getattr(element, "follow", None), p, s)
    return Node(look, move, find, lambda: s.status, None, follow)


def begun(tree: Tree, states: Iterator[Tree]) -> Tree:
    """The tree with other first states, in the order in which `node_of` appends them."""
    parts = [begun(part, states) for part in tree.get("parts", ())]
    own = {} if tree["kind"] == "series" else {"state": next(states)}
    return {**tree, **own, **({"parts": parts} if parts else {})}


def parts_of(tree: Tree) -> list[Tree]:
    """The parts of a node; those of one that learns twice, because they have two memories, before the model
    as it was fitted."""
    parts: list[Tree] = tree.get("parts", [])
    return [*parts[:-1], *parts] if tree["kind"] == "adaptive" else parts


def _made(kind: type, values: dict[str, Any]) -> Any:
    if "most" in kind.__annotations__:
        values = {"most": FOR_EVER} | values  # files lack it from before drifts stopped
    hints = get_type_hints(kind)
    check_fields(values, hints, kind.__name__.lower(), hints)
    made = kind()
    vars(made).update({k: list(v) if isinstance(v, list) else v for k, v in values.items()})
    return made


def _bound(function: Callable[..., float] | None, p: Any, s: Any) -> Any:
    if function is None or "dt" in inspect.signature(function).parameters:
        return function and partial(function, p, s)
    return lambda dt, value: function(p, s, value)


def _series(parts: list[Node]) -> Node:
    last_first = parts[::-1]
    said = [OK]

    def look(dt: float, u: float) -> float:
        for part in parts:
            u = part.look(dt, u)
        return u

    def move(dt: float, u: float) -> float:
        for part in parts:
            u = part.move(dt, u)
        return u

    def find(dt: float, y: float) -> float:
        said[0] = OK
        for part in last_first:
            y = part.find(dt, y)
            if said[0] == OK:
                said[0] = part.status()
        return y

    return Node(look, move, find, lambda: said[0])


def _scaled(element: Any, p: Any, s: Any, inner: list[Node]) -> Node:
    (part,) = inner
    return Node(
        lambda dt, u: element.onward(p, part.look(dt, u)),
        lambda dt, u: element.onward(p, part.move(dt, u)),
        lambda dt, y: part.find(dt, element.back(p, y)),
        part.status,
    )


def _share(element: Any, s: Any, inner: list[Node]) -> Node:
    (part,) = inner

    def look(dt: float, u: float) -> float:
        return element.weighted(s, part.look(dt, u)) if s.share else 0.0

    # It is found as a part of a sum, never by itself.
    return Node(look, lambda dt, u: element.weighted(s, part.move(dt, u)), part.find, lambda: OK)


def _sum(element: Any, p: Any, s: Any, parts: list[Node]) -> Node:
    # One after the other, as C adds: `sum` compensates its rounding from Python 3.12 on.
    first, rest = parts[0], parts[1:]
    first_look, looks = first.look, [part.look for part in rest]
    follows = [part.follow or part.move for part in parts]

    def look(whole: Any, dt: float, u: float) -> float:
        total = first_look(dt, u)
        for one in looks:
            total += one(dt, u)
        return total

    def move(dt: float, u: float) -> float:
        total = first.move(dt, u)
        for part in rest:
            total += part.move(dt, u)
        return total

    def find(dt: float, y: float) -> float:
        u = element.search(look, p, s, None, dt, y)
        for follow in follows:
            follow(dt, u)
        return u

    return Node(partial(look, None), move, find, lambda: s.status)


def _adaptive(element: Any, p: Any, s: Any, parts: list[Node]) -> Node:
    """The parts that remember estimates; the same, which teach; the model as it was fitted."""
    numbered, teaching = list(enumerate(parts[: p.parts])), list(enumerate(parts[p.parts : -1]))
    fitted = parts[-1]

    def look(whole: Any, dt: float, u: float) -> float:
        total = 0.0
        for k, part in numbered:
            total += element.one(p, s, k, part.look(dt, u))
        return element.zero_now(s) + element.raised(p, total)

    def followed(dt: float, u: float) -> float:
        total = 0.0
        for k, part in numbered:
            total += element.one(p, s, k, part.move(dt, u))
        return element.zero_now(s) + element.raised(p, total)

    def taught(dt: float, u: float) -> None:
        for k, part in teaching:
            element.taught(p, s, k, part.move(dt, u))

    def move(dt: float, u: float) -> float:
        taught(dt, u)
        return followed(dt, u)

    def find(dt: float, y: float) -> float:
        element.began(s, dt)
        u = fitted.find(dt, y)
        s.status = fitted.status()
        if s.share > 0.0:
            u = element.nearest(look, p, s, None, dt, p.sign * y)
        s.value = u
        if s.known:
            for k, part in numbered:
                element.kept(p, s, k, part.look(dt, s.reference))
        followed(dt, u)
        taught(dt, element.driving(s, u))
        if s.known:
            element.learn(p, s, y)
        return u

    def signed(of: Callable[[float, float], float]) -> Function:
        return lambda dt, u: p.sign * of(dt, u)

    outward = signed(partial(look, None)), signed(move)
    return Node(*outward, find, lambda: s.status, (element, p, s))
