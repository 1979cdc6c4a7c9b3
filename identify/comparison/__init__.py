"""Comparing fits: information criteria, PSIS-LOO, change, trend, pooling."""
