"""A record made ready for a fit: held-out folds, clocks, channels."""
