"""The memory of a Preisach model is a tree, and the tree depends on the input alone.

Every sample hangs on the reversal its branch started from, its *anchor*; every anchor hangs on the
one before it. When the input passes an older extremum, the loop inside is wiped out and the branch
hangs on the older anchor again: pushes and pops of a stack. So with

    rise_k = 2 s E(u_k, u_parent(k)),   s = +1 rising, -1 falling,

the change of the output from anchor k's parent to anchor k, the value at every anchor is a
cumulative sum over push (+rise) and pop (-rise) events, and every sample adds one rise of its own.
Nothing here knows a density: turning points, wipe-outs and event order come out as indices.
"""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int, Shaped

from .._errors import InputError

IntArray = Int[np.ndarray, " _"]


class MemoryTree(NamedTuple):
    """Where every sample and anchor of a path hangs; all entries are indices or signs, none is a value.

    - `anchor` (samples,): the anchor each sample of the path hangs on.
    - `node` (anchors,): the sample of the path each anchor stands at; anchor 0 is the path's start.
    - `parent` (anchors,): the anchor each anchor hangs on; its own for anchor 0.
    - `rising` (anchors,): +1 where the branch that starts at the anchor rises, -1 where it falls.
    - `event` (events,): what happens to the stack, in order of time. k: anchor k is pushed;
      anchors + k: anchor k is popped together with its parent; 2 anchors: nothing.
    - `position` (anchors,): the event that pushed the anchor.
    """

    anchor: Int[np.ndarray, " samples"]
    node: Int[np.ndarray, " anchors"]
    parent: Int[np.ndarray, " anchors"]
    rising: Int[np.ndarray, " anchors"]
    event: Int[np.ndarray, " events"]
    position: Int[np.ndarray, " anchors"]


def memory_tree(path: Float[np.ndarray, " samples"]) -> MemoryTree:
    """The memory tree of a path that starts at its own minimum, the negative saturation.

    Time: one pass of NumPy over the samples and one Python loop over the turning points alone.

    **Example:**

        >>> tree = hysteresis.preisach.memory_tree(u)
        >>> len(tree.parent)
        4
    """
    turning, end = _turning_points(path)
    value = path[np.append(turning, end)]
    anchors = len(turning)
    branch, top, landing, parent = _wipe_outs(value.tolist())
    # The path starts at its minimum, so the first branch rises, and branches alternate.
    rising = np.where(np.arange(anchors) % 2 == 0, 1, -1).astype(np.int32)

    # Branch k covers samples begin[k] .. begin[k+1]-1: from the sample after its anchor to the next
    # reversal, which belongs to the branch that it ends. The root's branch also holds the root itself.
    begin = np.append(turning + 1, len(path))
    begin[0] = 0
    sign, last = rising[branch], begin[branch + 1] - 1
    passed = _first_beyond(path, sign * value[parent[top]], sign, begin[branch], last)

    # Merge the two kinds of events, both sorted by branch. Each branch pushes its anchor and then pops, so
    # before the push of branch k come k pushes and all pops of the branches before it.
    pops = np.bincount(branch, minlength=anchors)
    position = np.arange(anchors) + np.cumsum(pops) - pops
    events = anchors + len(branch)
    is_pop = np.ones(events, bool)
    is_pop[position] = False
    event = np.empty(events, np.int32)
    event[position], event[is_pop] = np.arange(anchors), anchors + top

    # Between two events every sample hangs on the same anchor.
    since, holder = np.empty(events + 1, np.int64), np.empty(events, np.int32)
    since[position], since[:-1][is_pop], since[-1] = begin[:-1], passed, len(path)
    holder[position], holder[is_pop] = np.arange(anchors), landing
    anchor = np.repeat(holder, np.diff(since))
    return MemoryTree(
        anchor, turning.astype(np.int32), parent, rising, event, position.astype(np.int32)
    )


def _turning_points(path: Float[np.ndarray, " samples"]) -> tuple[Shaped[np.ndarray, " _"], int]:
    """Samples where the path turns, its start included, and the sample it ends at.

    A plateau turns at its first sample, whatever happens on it: sampling adds no memory.
    """
    step = np.diff(path)
    moving = np.flatnonzero(step)
    up = step[moving] > 0
    turns = np.flatnonzero(up[1:] != up[:-1])
    end = int(moving[-1]) + 1 if len(moving) else 0
    return np.concatenate([[0], moving[turns] + 1]), end


def _wipe_outs(
    value: list[float],
) -> tuple[IntArray, IntArray, IntArray, Int[np.ndarray, " anchors"]]:
    """Walk the turning values once with a stack.

    Returns for every wipe-out its branch, the younger of the two anchors that leave (the other is
    its parent) and the anchor landed on; and every anchor's parent.
    """
    anchors = len(value) - 1
    # Sentinels end the loop below without a check of the stack's length. An input may return exactly to the
    # saturation it started from; the root stays then, because nothing falls to -inf.
    extremum = [*value, np.inf]
    extremum[0] = -np.inf
    stack = [anchors + 1]
    branch, top, landing, parent = [], [], [], [0]
    for k in range(anchors):
        stack.append(k)
        x = extremum[k + 1]
        rises = k % 2 == 0
        # "or equal": a loop is closed as soon as the input is back at the extremum that opened it.
        while (x >= extremum[stack[-2]]) if rises else (x <= extremum[stack[-2]]):
            branch.append(k)
            top.append(stack.pop())
            stack.pop()
            landing.append(stack[-1])
        parent.append(stack[-1])
    integers = (np.array(a, np.int32) for a in (branch, top, landing, parent[:anchors]))
    return tuple(integers)  # type: ignore[return-value]


Wipes = Int[np.ndarray, " wipes"]


def _first_beyond(
    path: np.ndarray, level: Float[np.ndarray, " wipes"], sign: Wipes, first: Wipes, last: Wipes
) -> Wipes:
    """First sample in first..last with sign * path >= level, by one bisection for all at once.

    The path is monotone there, and its last sample is known to be beyond. White noise wipes out a loop
    about every third sample, hence one vectorised search instead of a search each in Python.
    """
    low, high = first.copy(), last.copy()
    open_ = np.flatnonzero(high > low)
    while len(open_):
        l, h = low[open_], high[open_]  # noqa: E741
        middle = (l + h) >> 1
        beyond = sign[open_] * path[middle] >= level[open_]
        low[open_] = np.where(beyond, l, middle + 1)
        high[open_] = np.where(beyond, middle, h)
        open_ = open_[low[open_] < high[open_]]
    return low


# The relays before the first sample, as inputs that lead there from all down.

Initial = str | tuple[float, ...]
"""One of `WORDS`, or inputs that lead from negative saturation to the state."""

WORDS = ("negative", "positive", "demagnetised")


def word_or_inputs(initial: Any) -> Initial:
    """As given, a sequence as a tuple of floats."""
    return initial if isinstance(initial, str) else tuple(float(u) for u in initial)


def check_initial(initial: Initial, low: float, high: float) -> None:
    """Raises `InputError` for an unknown word, or an input outside [low, high]."""
    if isinstance(initial, str):
        if initial not in WORDS:
            said = f"no initial state {initial!r}."
            mend = f"give one of {', '.join(WORDS)}, or a tuple of inputs."
            raise InputError("bad-option", said, fix=mend)
        return
    for u in initial:
        if not low <= u <= high:
            raise InputError(
                "out-of-range",
                f"an input that leads to the initial state is {u:g}, outside [{low:g}, {high:g}].",
                fix="clip it: beyond the bounds all relays are down, or all up.",
            )


def staircase(initial: Initial, low: float, high: float, turns: int) -> list[float]:
    """Inputs that bring the relays from negative saturation to the initial state."""
    if initial == "negative":
        return []
    if initial == "positive":
        return [high]
    if initial == "demagnetised":
        # An alternation that decays by the same step each time, as a laboratory demagnetises.
        amplitude = (high - low) / 2 * (1 - np.arange(turns) / turns)
        alternation = (low + high) / 2 + amplitude * (-1.0) ** np.arange(turns)
        # Half the sum and half the difference of two ends may round beyond them.
        return np.clip(alternation, low, high).tolist()
    return list(initial)  # type: ignore[arg-type]
