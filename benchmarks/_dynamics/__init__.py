"""Oscillators whose hysteresis is known, and fits of them judged on records they have not seen."""
