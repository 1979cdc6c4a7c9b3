"""The armor: calibration, touches, three-dimensional view."""
