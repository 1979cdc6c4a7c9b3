"""Levels by which several parts judge, each in one place."""

import numpy as np

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
"""Groups of cycles, or values of a condition, that are left out one by one, at most; of more, neighbours go
together."""

HELD = 0.02
"""Of a range or a size: what stays within it is held, or the same again."""

FEWEST = 8
"""Rows of a hold or of a spectrum, lines of a multisine, or sequences with known beginnings, at least."""

FEW = 20
"""Rows, steps or draws without which nothing is said of their distribution."""

SOME_ROWS = 2000
"""Rows, lines or draws that are looked at, about, where many more tell no more."""

ENOUGH_ROWS = 8000
"""Rows that many unknowns take: of a longer record one of every k, as neighbours are almost copies."""

AT_ONCE = 512
"""Rows or columns that are worked on at once: they stay in a processor's cache."""

HELD_AT_ONCE = 1_000_000
"""Rows, or rows times draws, series or candidates, that are held at once, at most: a minute of work, and a
gigabyte."""

STEPS = 200
"""Of a search, at most: one that converges ends before."""

WORTH = 0.2
"""Of the mean squared error: what a finer grid, or a lag, must take away."""

WHOLE = 0.9
"""Of the rows or the range of the largest one of its kind: what has so much of them is a whole one."""

COARSE = 20
"""Cells of a coarse even grid on an input's range; fine ones have two or four times as many."""

RADII = np.geomspace(0.01, 0.5, 10)
"""Of stop operators beside other columns, in parts of an input's range."""

PRIOR_STRENGTHS = tuple((1 / 10.0 ** np.arange(1, 6)).tolist())
"""Tried, the strongest first: in squares of the output's range, or of a standardised column."""

MUCH = 1.5
"""Times: from there on a figure is much larger than another of its kind."""

PART = 0.1
"""Of a whole: a smaller part is not worth a word."""

SEAM = 0.01
"""Of a range: what is so near to its end, or to a value, is as good as there."""

LITTLE = 1e-3
"""Of a range or a size: what is below is nearly nothing, as a digit of an instrument is."""

NOTHING = 1e-6
"""Of a range or a size: what is below is rounding, or where a search has stopped."""

ROUNDING = float(np.sqrt(np.finfo(float).eps))
"""Half of a number's digits, 1.5e-8: of a sum of squares or a range, what is below is lost in rounding."""

STILL = 1e-9
"""Of a sum of squares, or of a cost a row: a step that gains less stands still."""

SURE = 3.0
"""Standard errors beyond which a change is there."""

UNCERTAIN = 2.0
"""Standard error of a parameter's logarithm, a factor of 7, beyond which the data do not tell it."""
