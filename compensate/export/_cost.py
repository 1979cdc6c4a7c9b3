"""What each node of a compensator's tree costs at most."""

from collections.abc import Mapping, Sequence

from hysteresis.laws._tree import Tree

from . import _c99_adaptive
from ._operation_count import operations
from ._python_to_c99 import Element


def cost(
    tree: Tree, inner: Sequence[dict[str, int]], elements: Mapping[str, Element]
) -> dict[str, int]:
    """Operations of `look`, `move`, `follow` and `find` of a node; `inner`: those of the nodes in it."""
    if tree["kind"] == "adaptive":
        return _c99_adaptive.cost(elements["adaptive"], tree["parameters"], inner)
    names = ("look", "move", "find")
    # A part of a sum needs no inverse of its own, and then a series of such has none either.
    shared = [name for name in names if all(name in one for one in inner)]
    both = {name: sum(one[name] + 12 for one in inner) for name in shared}
    if tree["kind"] == "series":
        return both
    home, p = elements[tree["kind"]], tree["parameters"]
    if tree["kind"] == "sum":
        looked = operations(home, "search", p, {"look": both["look"]})
        followed = sum(one.get("follow", one["move"]) + 12 for one in inner)
        return both | {"find": looked + followed}
    if inner:
        return {name: cost + 60 for name, cost in both.items()}
    called = {"error": "deviation", "guard": "limited"}
    if tree["kind"] in called:
        return {"find": operations(home, called[tree["kind"]], p)}
    return {n: operations(home, n, p) + 12 for n in (*names, "follow") if n in home.functions}
