"""Compensators in plain Python: no JAX, no NumPy, a few microseconds a step.

compensator = load("compensator.json")
value, status, deviation = compensator.step(dt, reading)
"""

from ._armor import load_armor as load_armor
from ._contact import ContactStatus as ContactStatus
from ._contact_forces import load_contacts as load_contacts
from ._file import FileError as FileError
from ._load import load as load
from ._network import load_force as load_force
from ._status import Status as Status
