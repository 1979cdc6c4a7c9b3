"""The parts that a composition may have, and how many unknowns stand in a row of each."""

from ._sliders import LEVELS, PLACE_STOPS, PLACES, PLAYS, SPAN_STOPS, STOPS

CURVE, MAXWELL, STRENGTHS, SOFTENING, RELAYS = (
    "curve",
    "Maxwell",
    "strengths",
    "softening",
    "relays",
)
FRICTION = "friction"
DRIFT, TIME_DRIFT = "drift", "drift in time"
DRIFTS = (DRIFT, TIME_DRIFT)
PARTS = (
    CURVE, MAXWELL, STRENGTHS, SOFTENING, RELAYS, PLAYS, STOPS, PLACE_STOPS, SPAN_STOPS, FRICTION, *DRIFTS
)  # fmt: skip
CELLS = {CURVE: 40, MAXWELL: 12, STRENGTHS: 18, SOFTENING: 12, RELAYS: 24}
"""Cells of each part's even grid on the input's range."""

IN_A_ROW = {
    MAXWELL: CELLS[MAXWELL], STRENGTHS: CELLS[STRENGTHS] + 1, FRICTION: len(PLACES), DRIFT: len(PLACES),
    **{part: len(levels) for part, levels in LEVELS.items()},
}  # fmt: skip
"""Unknowns of a part that differ in their level alone."""
