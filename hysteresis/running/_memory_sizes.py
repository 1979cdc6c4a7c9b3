"""Sizes that all forms of `_memory.py` share."""

MOST = 16
"""Reals that one assignment may depend on."""
WIDE = 4
"""Columns of tangents at a time."""
