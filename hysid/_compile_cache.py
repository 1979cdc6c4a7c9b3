"""Compiled programs, kept from one process to the next."""

import contextlib
import hashlib
import os
import platform
import re
import stat
import warnings
from functools import cache
from pathlib import Path

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
    off = os.environ.get("JAX_ENABLE_COMPILATION_CACHE", "1").lower() in ("0", "false", "no", "off")
    if off or "JAX_COMPILATION_CACHE_DIR" in os.environ:
        return ""
    try:
        cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
        folder = cache / "hysid" / f"compiled-{_processor()}"
        cache.mkdir(parents=True, exist_ok=True)
        if fault := _shared(cache) or _not_own(folder.parent) or _not_own(folder):
            return f"Compiled programs are not kept: {fault}"
        _forget_oldest(folder)
    except (OSError, RuntimeError):
        return ""
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


def _shared(above: Path) -> str:
    """Why others could exchange what is in a folder; on Windows, whose homes are one's own, nothing."""
    if not hasattr(os, "getuid"):
        return ""
    about = above.stat()
    others = about.st_mode & 0o022 and not about.st_mode & stat.S_ISVTX
    if about.st_uid not in (0, os.getuid()) or others:
        return f"{above} belongs to another user, or others can write to it."
    return ""


def _not_own(folder: Path) -> str:
    """Why a folder, made here if it is missing, is not this user's alone."""
    with contextlib.suppress(FileExistsError):
        folder.mkdir(mode=0o700)
    about = folder.lstat()
    if not stat.S_ISDIR(about.st_mode):
        return f"{folder} is a link, not a folder."
    if not hasattr(os, "getuid"):
        return ""
    if about.st_uid != os.getuid() or about.st_mode & 0o022:
        return f"{folder} belongs to another user, or others can write to it."
    if about.st_mode & 0o077:
        folder.chmod(0o700)
    return ""


def _processor() -> str:
    """A home may be shared by machines, of which one cannot run what another has compiled."""
    said = platform.machine() + platform.processor()
    facts = Path("/proc/cpuinfo")
    if facts.exists():
        lines = facts.read_text("utf-8", "replace").splitlines()
        said += next((line for line in lines if line.startswith(("flags", "Features"))), "")
    return hashlib.sha256(said.encode()).hexdigest()[:12]


def _forget_oldest(folder: Path) -> None:
    """Down to half of what may be kept, once there is more; only files that JAX has named."""
    named = (file for file in folder.iterdir() if _ENTRY.fullmatch(file.name))
    files = [(about, file) for file in named if stat.S_ISREG((about := file.lstat()).st_mode)]
    size = sum(about.st_size for about, _ in files)
    least = MOST / 2 if size > MOST else MOST
    for about, file in sorted(files, key=lambda one: one[0].st_mtime):
        if size <= least:
            return
        file.unlink(missing_ok=True)
        size -= about.st_size
