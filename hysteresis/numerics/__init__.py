"""Numerical helpers: recurrences, clamps, kernels."""
