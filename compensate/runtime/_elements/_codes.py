"""The statuses as plain numbers, see `Status`, and the arrays."""

Reals = list[float]
"""In C an array of fixed length."""

OK = 0
EXTRAPOLATED = 1
SATURATED = 2
FLAT = 3
BELOW_THRESHOLD = 4
