"""A tree of laws, run in plain Python."""

from collections.abc import Callable, Iterator
from functools import lru_cache, partial
from math import nan
from types import CodeType
from typing import Any, NamedTuple, get_type_hints

from . import FORGET, KINDS, announced, module_of
from ._nodes import WITHOUT, Node, functions_of
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


class Running(NamedTuple):
    """`look`, `move`, `find` of (dt, value), as of a law; the last one's `status()`; `learner`: law,
    parameters and state of a node that learns."""

    look: Function
    move: Function
    find: Function
    status: Callable[[], int]
    learner: tuple[Any, Any, Any] | None


FOR_EVER = 1e30


def node_of(
    tree: Tree, states: list[Any] | None = None, takes: list[Callable[[float], float]] | None = None
) -> Running:
    """The functions of a tree, with states of its own, which are appended to `states`.

    `takes`: to which is appended whatever takes the condition before a reading.
    """
    trees: list[Tree] = []
    root = _numbered(tree, trees)
    space: dict[str, Any] = {"Any": Any}
    for k, own in enumerate(trees):
        if (kind := own["kind"]) == WITHOUT:
            continue
        law = module_of(kind)
        p, s = _made(law.Parameters, own["parameters"]), _made(law.State, own["state"])
        space |= {f"p{k}": p, f"s{k}": s}
        space |= {f"{kind}__{name}": function for name, function in vars(law).items()}
        if states is not None:
            states.append(s)
        if kind == "share" and takes is not None:
            takes.append(partial(law.take, p, s))
    exec(_code(root), space)
    k = root.number

    made: list[Any] = [space.get(f"{x}_{k}") for x in ("look", "move", "find", "status")]
    look, move, find, status = (function and partial(function, None) for function in made)
    learns = root.kind == "adaptive"
    learner = (module_of("adaptive"), space[f"p{k}"], space[f"s{k}"]) if learns else None
    return Running(look, move, find, status, learner)


def _numbered(tree: Tree, trees: list[Tree]) -> Node:
    kind = tree["kind"]
    if kind not in (*KINDS, *announced()):
        raise ValueError(f"no element {kind!r}")
    parts = tuple(_numbered(part, trees) for part in parts_of(tree))
    trees.append(tree)
    return Node(kind, len(trees) - 1, parts)


@lru_cache(100)
def _code(root: Node) -> CodeType:
    return compile(functions_of(root), "<tree>", "exec")


FORGET.append(_code.cache_clear)


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
