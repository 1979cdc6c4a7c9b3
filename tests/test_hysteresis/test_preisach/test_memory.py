"""The memory tree against a stack kept sample by sample, and the laws of that memory."""

from typing import Any, NamedTuple

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from hysteresis.preisach import memory_tree
from tests.problems import histories

histories_here = histories(0.0, 1.0)


class Stack(NamedTuple):
    """What a stack says after every sample of a path: the reversal it hangs on and its direction."""

    anchor: np.ndarray
    rising: np.ndarray
    output: np.ndarray


def everett(a: Any, b: Any) -> Any:
    """E of the density 1."""
    return (a - b) ** 2 / 2


def stack_loop(path: np.ndarray) -> Stack:
    """The slow oracle: one stack of (reversal, output there), pushed and popped at every sample."""
    stack, s, before, y = [(path[0], 0.0)], 1, path[0], 0.0
    anchor, rising, output = [], [], []
    for x in path:
        if x != before and np.sign(x - before) != s:
            stack.append((before, y))
            s = -s
        while len(stack) >= 3 and s * x >= s * stack[-2][0]:
            del stack[-2:]
        r, level = stack[-1]
        y, before = level + 2 * s * everett(x, r), x
        anchor.append(r)
        rising.append(s)
        output.append(y)
    return Stack(*map(np.array, (anchor, rising, output)))


def from_tree(path: np.ndarray, tree: Any) -> np.ndarray:
    """The outputs, from sums over the events of the tree."""
    at = path[tree.node]
    rise = 2 * tree.rising[tree.parent] * everett(at, at[tree.parent])
    change = np.concatenate([rise, -(rise + rise[tree.parent]), [0.0]])
    level = np.cumsum(change[tree.event])[tree.position]
    own = 2 * tree.rising[tree.anchor] * everett(path, at[tree.anchor])
    return level[tree.anchor] + own


def path_of(u: Any) -> np.ndarray:
    """A path that starts where all relays are down."""
    return np.concatenate([[0.0], u])


# Sums of at most 41 rises of at most 1: rounding stays below 41 eps = 1e-14.
ROUNDING = 1e-13


@given(histories_here, st.data())
def test_a_closed_excursion_is_wiped_out(u: np.ndarray, data: st.DataObject):
    """From a sample back towards the branch's anchor and up to the sample again: nothing is left."""
    path = path_of(u)
    k = data.draw(st.integers(1, len(path) - 1), "sample")
    stack = stack_loop(path)
    share = data.draw(st.floats(0, 1), "depth")
    inside = path[k] + share * (stack.anchor[k] - path[k])
    longer = np.concatenate([path[: k + 1], [inside, path[k]], path[k + 1 :]])
    y = from_tree(longer, memory_tree(longer))
    np.testing.assert_allclose(np.delete(y, [k + 1, k + 2]), stack.output, rtol=0, atol=ROUNDING)
