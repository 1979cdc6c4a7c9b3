"""`hysid check`."""

from typing import Any

from ..intake._selection_options import FIELDS, HELD_OUT
from ._config_file import Config
from ._console import AsJson, File, print_result, start_jax, warnings
from ._selection import takes_selection


@takes_selection(*(name for name in FIELDS if name not in HELD_OUT))
def check(
    file: File, selection: dict[str, Any], config: Config = None, as_json: AsJson = False
) -> None:
    """Describe a record and what makes a model hard to identify."""
    start_jax()
    from ..intake._selection import Selection  # after JAX is set up
    from ..operations import _check

    found = _check.check(file, Selection(**selection))
    each, lines = selection["each"], []
    for value, one in found.get("each", {"": found}).items():
        lines += [f"{each} = {value}"] if value else []
        lines += [one.pop("text"), *warnings(one["warnings"])]
    failed = found.get("failed", {}).items()
    print_result(
        found, as_json, [*lines, *(f"{each} = {v} cannot be used: {e}" for v, e in failed)]
    )
