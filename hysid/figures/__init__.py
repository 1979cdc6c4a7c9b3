"""Matplotlib figures, number formatting, notebook display."""
