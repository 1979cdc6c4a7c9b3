"""Whether what leaves the package is right: compensators, their bands, verdicts, intervals, claims.

python -m benchmarks.trust [--quick] [--json] [--only TEXT]

Each part is a file of `benchmarks/_trust/` with a function `rows(quick)`.
"""

from collections.abc import Sequence
from importlib import import_module
from pkgutil import iter_modules

from . import _trust
from ._measure import run_parts


def main(arguments: Sequence[str] | None = None) -> None:
    """Run every part and print."""
    names = sorted(module.name for module in iter_modules(_trust.__path__))
    parts = {name: import_module(f"{_trust.__name__}.{name}").rows for name in names}
    run_parts("benchmarks.trust", __doc__, parts, arguments)


if __name__ == "__main__":
    main()
