"""Calibration of any residual system, and optimal experimental design."""
