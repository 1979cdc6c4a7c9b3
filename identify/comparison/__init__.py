"""Comparing fits: information criteria, PSIS-LOO, change, pooling."""
