"""Compensators without JAX: the JSON runtime file and the C99 header."""
