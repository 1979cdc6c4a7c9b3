"""hysid: from a test rig's CSV to a compensator that can be trusted inside a robot.

The names people use most, in one place; each loads its package when it is first used. `__init__.pyi`
lists them once, for type checkers and for this file.
"""

# hysid:own-package, which hysid/_packages.py looks for

from ._packages import check_packages as _check_packages

_check_packages()

from hysteresis._lazy import loaded_late as _loaded_late  # noqa: E402

__getattr__, __dir__, __all__ = _loaded_late(__name__, __file__)
