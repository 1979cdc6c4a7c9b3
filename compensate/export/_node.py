"""A node of a tree of elements: plain numbers and lists."""

from typing import Any

import numpy as np

from ..runtime._status import Status

Tree = dict[str, Any]

ONE_WAY = ("moving", "oscillator")
"""Kinds of elements that run from reading to estimate only."""


def node(kind: str, parameters: Tree, state: Tree | None = None, parts: Any = ()) -> Tree:
    """One element, its numbers plain."""
    plain = {"parameters": parameters, "state": {"status": int(Status.OK)} | (state or {})}
    values = {name: {k: _flat(v) for k, v in part.items()} for name, part in plain.items()}
    return {"kind": kind, **values, **({"parts": list(parts)} if parts else {})}


def _flat(value: Any) -> Any:
    if isinstance(value, bool | int):
        return int(value)
    array = np.asarray(value)
    return array.ravel().tolist() if array.ndim else array.item()
