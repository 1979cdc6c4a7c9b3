"""Solvers for models of few, non-linear parameters."""
