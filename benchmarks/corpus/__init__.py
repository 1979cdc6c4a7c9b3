"""Frozen numbers of laws, inverses, exports and fits."""
