"""Exact inverses, one file per model."""
