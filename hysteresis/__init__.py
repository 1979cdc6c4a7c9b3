"""What a material or a sensor does: models with memory, records of measurements, virtual rigs.

`hysteresis.laws` runs without JAX, so each name loads its file when it is first used.
"""

# hysid:own-package, which hysid/_packages.py looks for

from ._lazy import loaded_late as _loaded_late

__getattr__, __dir__, __all__ = _loaded_late(__name__, __file__)
