"""A tree of laws, run in plain Python."""

from collections.abc import Callable, Iterator
from functools import lru_cache, partial
from math import nan
from types import CodeType
from typing import Any, NamedTuple, get_type_hints

from . import FORGET, KINDS, announced, module_of
from ._nodes import AROUND, BESIDE, WITHOUT, Node, functions_of
from ._types import check_fields

Function = Callable[[float, float], float]
Tree = dict[str, Any]


def around(document: Tree) -> Tree:
    """The tree of a compensator's document, with what is around it; what is not a number is None."""
    error, guard, condition = (document.get(x) for x in ("error", "guard", "condition"))
    low, high = document["limits"]
    least, most = (condition or {}).get("low", 0.0), (condition or {}).get("high", 0.0)
    parameters = {
        "low": low, "high": high, "rates": int(document["rates"]),
        "longest": document.get("longest") or FOR_EVER, "conditioned": int(condition is not None),
        "least": least, "most": most, "hides": int(bool(guard) and guard["beyond"] == "nan"), "none": None,
    }  # fmt: skip
    state = {
        "status": 0, "value": document["start"], "deviation": None, "waited": 0.0, "begun": 0,
    }  # fmt: skip
    tree, parts = document["tree"], []
    if error:
        law: Any = module_of("error")
        parts.append({
            "kind": "error", "parameters": law.ANY_MOTION | error["parameters"],
            "state": law.UNMOVED | error["state"],
        })  # fmt: skip
    if guard:
        state_of_guard = module_of("guard").BEGUN | guard["state"]
        parts.append({**guard, "kind": "guard", "state": state_of_guard})
    others = [begun(tree, iter(states)) for states in document.get("starts", [])]
    return {
        "kind": AROUND, "parameters": parameters, "state": state, "parts": [tree, *others, *parts],
    }  # fmt: skip


class Running(NamedTuple):
    """`look`, `move`, `find` of (dt, value), as of a law; the last one's `status()`."""

    look: Function
    move: Function
    find: Function
    status: Callable[[], int]


FOR_EVER = 1e30


class Around(NamedTuple):
    """`step` of (dt, reading, condition); its state; `learner`: law, parameters and state of a node that
    learns."""

    step: Callable[[float, float, float], float]
    state: Any
    learner: tuple[Any, Any, Any] | None


def node_of(
    tree: Tree, states: list[Any] | None = None, takes: list[Callable[[float], float]] | None = None
) -> Running:
    """The functions of a tree, with states of its own, which are appended to `states`.

    `takes`: to which is appended whatever takes the condition before a reading.
    """
    root, space = _made_of(tree, [] if states is None else states)
    if takes is not None:
        shares = [one.number for one in root.all() if one.kind == "share"]
        takes += [partial(space["share__take"], space[f"p{k}"], space[f"s{k}"]) for k in shares]
    look, move, find, status = (
        (function := space.get(f"{x}_{root.number}")) and partial(function, None)
        for x in ("look", "move", "find", "status")
    )
    return Running(look, move, find, status)  # type: ignore[arg-type]


def step_of(tree: Tree, states: list[Any]) -> Around:
    """What runs a tree with what is `around` it; as `node_of`."""
    root, space = _made_of(tree, states)
    k, inner = root.number, root.parts[0]
    own = module_of("adaptive"), space.get(f"p{inner.number}"), space.get(f"s{inner.number}")
    learner = own if inner.kind == "adaptive" else None
    return Around(partial(space[f"step_{k}"], None), space[f"s{k}"], learner)


def _made_of(tree: Tree, states: list[Any]) -> tuple[Node, dict[str, Any]]:
    trees: list[Tree] = []
    root = _numbered(tree, trees)
    space: dict[str, Any] = {"Any": Any}
    for k, own in enumerate(trees):
        if (kind := own["kind"]) == WITHOUT:
            continue
        law = module_of(kind)
        given = (own["parameters"], own["state"])
        if kind == AROUND:  # not of the file
            p, s = law.Parameters(), law.State()
            for one, values in zip((p, s), given, strict=True):
                vars(one).update({name: nan if v is None else v for name, v in values.items()})
        else:
            p, s = _made(law.Parameters, given[0]), _made(law.State, given[1])
        space |= {f"p{k}": p, f"s{k}": s}
        space |= {f"{kind}__{name}": function for name, function in vars(law).items()}
        states.append(s)
    exec(_code(root), space)
    return root, space


def _numbered(tree: Tree, trees: list[Tree], within: str = "") -> Node:
    """`within`: the kind of the whole; only what is around a tree has parts that are none."""
    kind, beside = tree["kind"], {"": (AROUND,), AROUND: BESIDE}.get(within, ())
    if kind not in (*KINDS, *announced(), *beside):
        raise ValueError(f"no element {kind!r}")
    parts = tuple(_numbered(part, trees, kind) for part in parts_of(tree))
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
