"""Gradient training of networks, and the scales of a Gaussian process."""
