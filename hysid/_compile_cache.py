"""Compiled programs, kept from one process to the next."""

import contextlib
import os
import re
import warnings

MOST = 500_000_000
"""Bytes of programs that are kept; a fit's take less than one million."""


_ENTRY = re.compile(r"[\w.-]+-[0-9a-f]{64}-(cache|atime)")
"""Names that JAX gives its files."""


def keep_compiled() -> str:
    """Have JAX keep its programs in the user's cache folder, here and in processes that this one starts.

    Most of a fit's time goes into compiling what the last one compiled. JAX's own settings have the last
    word: JAX_COMPILATION_CACHE_DIR, or `jax.config`, names another folder, and
    JAX_ENABLE_COMPILATION_CACHE=0 keeps nothing. Nor is anything kept where there is no home to keep it in.

    JAX runs what it finds there. So the folder is for this user alone, and one that is a link, belongs to
    somebody else or can be written by others is neither read nor written. Returns why, "" otherwise.
    """
    import jax  # late: help needs neither

    from hysteresis._files import forget_oldest, own_folder

    given = jax.config.jax_compilation_cache_dir  # type: ignore[attr-defined]
    if given or not jax.config.jax_enable_compilation_cache:  # type: ignore[attr-defined]
        return ""
    folder, refused = own_folder("compiled")
    if folder is None:
        return refused
    with contextlib.suppress(OSError):
        forget_oldest(folder, MOST, _ENTRY)
    os.environ["JAX_COMPILATION_CACHE_DIR"] = str(folder)
    jax.config.update("jax_compilation_cache_dir", str(folder))
    # The small ones are many: a second fit takes 6.6 s with them, 8.4 without, 14 with none kept at all.
    least = os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")
    jax.config.update("jax_persistent_cache_min_compile_time_secs", float(least))
    # What cannot be read, since a disk was full or another process is writing it, is compiled again.
    warnings.filterwarnings("ignore", "Error (reading|writing) persistent compilation cache")
    return ""
