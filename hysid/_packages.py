"""Whether the four packages that would be imported are those of hysid. Imports nothing but Python's own.

Another distribution owns the name `identify`, and one `hysteresis`. pip installs them over ours, or ours
over them, without a word, and a file of such a name in the current folder goes first as well.
"""

import sys
from importlib.machinery import PathFinder
from importlib.util import find_spec
from pathlib import Path

NAMES = ("hysteresis", "identify", "compensate", "hysid")
MARK = "hysid:own-package"
"""A comment in the `__init__.py` of each, which is the first file that another distribution replaces."""


def fault_of_packages() -> str:
    """Why the packages cannot be used, and what to do, in one line; "" where all four are ours."""
    for name in NAMES:
        place = _place(name)
        if place is None:
            return f"the package {name!r} of hysid is missing. {_AGAIN}"
        try:
            is_ours = MARK in place.read_text("utf-8")
        except (OSError, ValueError):
            is_ours = False
        if not is_ours:
            said = f"hysid needs its own package {name!r}, but Python finds another one: {place}."
            return f"{said} {_cause(name, place)}"
    return ""


def check_extra(extra: str, *names: str) -> None:
    """Raise `InputError` `missing-extra` where one of these packages of an extra is not installed."""
    if missing := [name for name in names if find_spec(name) is None]:
        from hysteresis import InputError  # late: whether that package is ours is asked first

        fix = f"Install it with pip install 'hysid[{extra}]'."
        raise InputError("missing-extra", f"{missing[0]} is not installed.", fix=fix)


def is_command() -> bool:
    """Whether this process was started as `hysid` or `python -m hysid`, which say it in their own words."""
    return Path(sys.argv[0] if sys.argv else "").stem in ("-m", "hysid", "hysid-script")


def _place(name: str) -> Path | None:
    """Where a package is, or would be imported from."""
    if (there := getattr(sys.modules.get(name), "__file__", None)) is not None:
        return Path(there)
    found = PathFinder.find_spec(name)
    if found is None or found.origin is None:
        # An editable installation may have a finder of its own, which PathFinder does not ask.
        beside = Path(__file__).parents[1] / name / "__init__.py"
        return beside if beside.is_file() and found is None else None
    return Path(found.origin)


_AGAIN = (
    "Fix: install hysid in an environment of its own:"
    " python -m venv .venv; .venv/bin/pip install hysid."
)


def _cause(name: str, place: Path) -> str:
    if place.name != "__init__.py" or not place.parent.parent.samefile(Path(__file__).parents[1]):
        kind = "file" if place.name != "__init__.py" else "folder"
        where = place if kind == "file" else place.parent
        return f"Likely cause: a {kind} of this name comes first. Fix: rename {where}, or start elsewhere."
    return f"Likely cause: another distribution named {name!r} was installed over it. {_AGAIN}"
