"""Comparing fits: information criteria, change, pooling."""
