"""Creep and relaxation spectra, Prony series and their extrapolation."""
