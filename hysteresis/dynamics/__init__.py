"""Hysteresis inside a moving mass: operators in rate form, the oscillator, and its recording."""
