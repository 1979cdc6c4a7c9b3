"""Loops over time, appended to the text of a tree: STATE, take, move, found, move_r, ... are the tree's.

All arguments are addresses and lengths; c are the conditions. m holds `size` reals, from whole(n, STATE) on
the state. A sequence begins, in the state of `first`, at every row whose dt is not 0 or more: where
it is NaN at once, where it is negative after that time.
"""
# pyright: basic, reportUndefinedVariable=false


def loop(made):
    """Here nothing is compiled."""
    return made


njit = loop


@njit
def begun(m, n, first, size, h):
    """The time before a row; m in the first state where a sequence begins."""
    if h >= 0.0:
        return h
    for i in range(whole(n, STATE), size):
        put(m, i, get(first, i))
    return -h if h < 0.0 else 0.0


@loop
def run(m, n, first, size, u, dt, c, rows, y):
    for k in range(rows):
        h = begun(m, n, first, size, get(dt, k))
        take(m, n, get(c, k))
        put(y, k, move(m, n, h, get(u, k)))


@loop
def looks(m, n, first, size, u, dt, c, rows, y, levels, count):
    """As `run`; in y the outputs at each row's `count` levels before it, where these are numbers."""
    for k in range(rows):
        h = begun(m, n, first, size, get(dt, k))
        take(m, n, get(c, k))
        for j in range(k * count, (k + 1) * count):
            x = get(levels, j)
            put(y, j, look(m, n, h, x) if x == x else x)
        move(m, n, h, get(u, k))


@loop
def find(m, n, first, size, y, dt, c, rows, u, status):
    for k in range(rows):
        h = begun(m, n, first, size, get(dt, k))
        take(m, n, get(c, k))
        put(u, k, found(m, n, h, get(y, k)))
        put(status, k, 1.0 * status_of(m, n))


@loop
def find_told(m, n, first, size, y, dt, c, rows, u, status, said):
    """As `find`, and what the law around the tree says then. Where y is not finite nothing moves. No
    sequence begins."""
    for k in range(rows):
        x = get(y, k)
        if x - x == 0.0:
            take(m, n, get(c, k))
            put(u, k, found(m, n, get(dt, k), x))
            put(status, k, 1.0 * status_of(m, n))
        told(m, n, said, k)


@loop
def tangents(
    m, n, first, size, u, dt, c, rows, t, D, width, columns, dfirst, moved, du, since, every, y, dy
):
    """D: a row of `width` for every real; dfirst (size, width) its rows of m at first; du (rows, columns),
    tangents of the input, where it is `moved`; dy those of the output, of every `every`th row from `since`
    on."""
    at = 0
    for i in range(size * width):
        put(D, LOCALS * width + i, get(dfirst, i))
    for k in range(rows):
        h = begun(m, n, first, size, get(dt, k))
        if not get(dt, k) >= 0.0:
            for i in range(whole(n, STATE) * width, size * width):
                put(D, LOCALS * width + i, get(dfirst, i))
        if moved:
            for j in range(columns):
                put(D, U * width + j, get(du, k * columns + j))
        take(m, n, get(c, k))
        put(y, k, move_r(m, n, t, h, get(u, k)))
        if k >= since and (k - since) % every == 0:
            for j in range(columns):
                put(dy, at + j, get(D, Y * width + j))
            at = at + columns


@loop
def find_tangents(
    m, n, first, size, y, dt, c, rows, t, D, width, columns, dfirst, moved, dy, u, status, du, kept
):
    """As `tangents`, of the inverse. One column more is that by the input, of which the output has the
    tangent dy:  du = (dy - rest) / slope.  `kept`: place for two states."""
    for i in range(size * width):
        put(D, LOCALS * width + i, get(dfirst, i))
    for k in range(rows):
        h = begun(m, n, first, size, get(dt, k))
        if not get(dt, k) >= 0.0:
            for i in range(whole(n, STATE) * width, size * width):
                put(D, LOCALS * width + i, get(dfirst, i))
        for j in range(width):
            put(D, U * width + j, 1.0 if j == columns else 0.0)
        take(m, n, get(c, k))
        for i in range(whole(n, STATE), size):
            put(kept, i, get(m, i))
        x = found(m, n, h, get(y, k))
        put(u, k, x)
        put(status, k, 1.0 * status_of(m, n))
        # Marks are those of the move to that input; numbers stay as the search has left them.
        for i in range(whole(n, STATE), size):
            put(kept, size + i, get(m, i))
            put(m, i, get(kept, i))
        move_r(m, n, t, h, x)
        slope = get(D, Y * width + columns)
        for j in range(columns):
            wanted = get(dy, k * columns + j) if moved else 0.0
            rest = wanted - get(D, Y * width + j)
            put(du, k * columns + j, rest / slope if slope != 0.0 else 0.0)
        for i in range(whole(n, STATE), size):
            put(m, i, get(kept, size + i))
            row = (LOCALS + i) * width
            by_input = get(D, row + columns)
            if by_input != 0.0:
                for j in range(columns):
                    put(D, row + j, get(D, row + j) + by_input * get(du, k * columns + j))
                put(D, row + columns, 0.0)
