"""Identification of oscillators: a mass on a spring, a damper and a hysteretic force."""
