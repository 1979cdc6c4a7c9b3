"""Compensators with a standard deviation: ensembles, calibrated, filtered."""
