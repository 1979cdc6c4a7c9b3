"""Sizes that all forms of `_memory.py` share."""

MOST = 16
"""Reals that one assignment may depend on."""
WIDE = 4
"""Columns of tangents at a time."""
NONE, WIDELY = -1, -2
"""In place of a column: a parameter without tangents, and one with several, or with another than 1."""
