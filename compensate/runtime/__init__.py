"""Compensators in plain Python: no JAX, no NumPy, a few microseconds a step.

compensator = load("compensator.json")
value, status, deviation = compensator.step(dt, reading)
"""

from ._contact import ContactStatus as ContactStatus
from ._file import FileError as FileError
from ._load import load as load
from ._status import Status as Status
