"""Which versions of which software made a result."""

import platform
from collections.abc import Iterable
from functools import cache
from importlib.metadata import PackageNotFoundError, version

FIT = ("hysid", "jax", "equinox", "optimistix", "emcee", "numpy")
"""Packages that a fit depends on."""


def versions(packages: Iterable[str] = FIT) -> dict[str, str]:
    """The versions of Python and of `packages`; "not installed" for one that is missing."""
    return {"python": platform.python_version()} | {name: _version(name) for name in packages}


@cache
def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"
