"""Quantiles of the normal distribution."""

NORMAL_95 = 1.6448536269514722
"""The 95 % quantile: 90 % of a normal distribution lie within this many standard deviations of its mean."""
