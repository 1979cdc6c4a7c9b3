"""Compiled programs, kept from one process to the next."""

import contextlib
import os
import re
import warnings
from functools import cache

MOST = 500_000_000
"""Bytes of programs that are kept; a fit's take less than one million."""


_ENTRY = re.compile(r"[\w.-]+-[0-9a-f]{64}-(cache|atime)")
"""Names that JAX gives its files."""


def keep_compiled() -> str:
    """Have JAX, which is not loaded yet, keep its programs in the user's cache folder.

    Most of a fit's time goes into compiling what the last one compiled. Processes that this one starts do
    the same. JAX's own variables have the last word: JAX_COMPILATION_CACHE_DIR names another folder, and
    JAX_ENABLE_COMPILATION_CACHE=0 keeps nothing. Nor is anything kept where there is no home to keep it in.

    JAX runs what it finds there. So the folder is for this user alone, and one that is a link, belongs to
    somebody else or can be written by others is neither read nor written. Returns why, "" otherwise.
    """
    from hysteresis._cache_folder import forget_oldest, own_folder  # late: help needs neither

    off = os.environ.get("JAX_ENABLE_COMPILATION_CACHE", "1").lower() in ("0", "false", "no", "off")
    if off or "JAX_COMPILATION_CACHE_DIR" in os.environ:
        return ""
    folder, refused = own_folder("compiled")
    if folder is None:
        return refused
    with contextlib.suppress(OSError):
        forget_oldest(folder, MOST, _ENTRY)
    os.environ["JAX_COMPILATION_CACHE_DIR"] = str(folder)
    # The small ones are many: a second fit takes 6.6 s with them, 8.4 without, 14 with none kept at all.
    os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")
    # What cannot be read, since a disk was full or another process is writing it, is compiled again.
    warnings.filterwarnings("ignore", "Error (reading|writing) persistent compilation cache")
    return ""


@cache
def keep_compiled_by_python() -> None:
    """The same where a program of the user's has loaded JAX, which then reads its variables no more.

    A folder that the program has given to `jax.config`, or a cache that it has turned off there, stays.
    """
    import jax  # late: the command line sets its variables before

    given = jax.config.jax_compilation_cache_dir  # type: ignore[attr-defined]
    wanted = jax.config.jax_enable_compilation_cache  # type: ignore[attr-defined]
    if given or not wanted:
        return
    if refused := keep_compiled():
        warnings.warn(refused, stacklevel=3)
    if (folder := os.environ.get("JAX_COMPILATION_CACHE_DIR")) is not None:
        least = os.environ.get("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")
        jax.config.update("jax_compilation_cache_dir", folder)
        jax.config.update("jax_persistent_cache_min_compile_time_secs", float(least))
