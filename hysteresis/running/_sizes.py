MOST = 16
"""Reals that one assignment may depend on."""
