"""Measured data by third parties: what there is, and fetching it."""
