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

HELD = 0.02
"""Of the range: an input that stays within it is held."""

FEWEST = 8
"""Rows of a hold or of a spectrum, or lines of a multisine, at least."""

FEW = 20
"""Rows, steps or draws without which nothing is said of their distribution."""

SOME_ROWS = 2000
"""Rows that are looked at, about, where many more tell no more."""

STEPS = 40
"""Of a search, at most: one that converges ends before."""

MUCH = 1.5
"""Times: from there on a figure is much larger than another of its kind."""

LITTLE = 1e-3
"""Of a range or a size: what is below is nearly nothing, as a digit of an instrument is."""

NOTHING = 1e-6
"""Of a range or a size: what is below is rounding, or where a search has stopped."""

SURE = 3.0
"""Standard errors beyond which a change is there."""

UNCERTAIN = 2.0
"""Standard error of a parameter's logarithm, a factor of 7, beyond which the data do not tell it."""
