"""Judging a compensator on data it has not seen."""
