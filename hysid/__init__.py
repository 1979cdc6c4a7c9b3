"""hysid: from a test rig's CSV to a compensator that can be trusted inside a robot.

The names people use most, in one place; each loads its package when it is first used. `__init__.pyi`
lists them once, for type checkers and for this file.
"""

# hysid:own-package, which hysid/_packages.py looks for

from ._packages import fault_of_packages, is_command

if not (_said := fault_of_packages()):
    from hysteresis._lazy import loaded_late as _loaded_late

    __getattr__, __dir__, __all__ = _loaded_late(__name__, __file__)
elif is_command():
    import sys

    from .commands._console import USER, fault, stop

    stop(fault("foreign-package", _said), _said, USER, "--json" in sys.argv)
else:
    raise ImportError(_said)
