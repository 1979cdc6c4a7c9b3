"""Levels by which several parts judge, each in one place."""

CHANCE = 0.01
"""Of a false alarm: what chance alone makes less often is said."""

CONFIDENCE = 0.9
"""Of intervals and ranges."""

FACTOR = 1e3
"""Factor of a log-normal prior that says hardly anything: two thirds within three decades."""

MANY_ROWS = 100_000
"""Of more rows some, or none, are looked at where a judgement takes several passes over them."""

REPEATS = 3
"""Cycles, loops or specimens that tell how far they differ, at least."""

TRIES = 3
"""Times that something is tried which other processes may disturb."""

GROUPS = 12
"""Groups of cycles that are left out one by one, at most; of more, neighbours go together."""

HELD, HELD_ROWS = 0.02, 8
"""A hold: so many rows in which the input stays within this part of its range."""
