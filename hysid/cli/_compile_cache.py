"""Compiled programs, kept from one command to the next."""

import hashlib
import os
import platform
import warnings
from pathlib import Path

MOST = 500_000_000
"""Bytes of programs that are kept; a fit's take less than one million."""


def keep_compiled() -> None:
    """Have JAX, which is not loaded yet, keep its programs in the user's cache folder.

    Most of a fit's time goes into compiling what the last one compiled. Processes that this one starts do
    the same. JAX's own variables have the last word: JAX_COMPILATION_CACHE_DIR names another folder, and
    JAX_ENABLE_COMPILATION_CACHE=0 keeps nothing. Nor is anything kept where there is no home to keep it in.
    """
    off = os.environ.get("JAX_ENABLE_COMPILATION_CACHE", "1").lower() in ("0", "false", "no", "off")
    if off or "JAX_COMPILATION_CACHE_DIR" in os.environ:
        return
    try:
        cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
        folder = cache / "hysid" / f"compiled-{_processor()}"
        folder.mkdir(parents=True, exist_ok=True)
        _forget_oldest(folder)
    except (OSError, RuntimeError):
        return
    os.environ["JAX_COMPILATION_CACHE_DIR"] = str(folder)
    # The small ones are many: a second fit takes 6.6 s with them, 8.4 without, 14 with none kept at all.
    os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")
    # What cannot be read, since a disk was full or another process is writing it, is compiled again.
    warnings.filterwarnings("ignore", "Error (reading|writing) persistent compilation cache")


def _processor() -> str:
    """A home may be shared by machines, of which one cannot run what another has compiled."""
    said = platform.machine() + platform.processor()
    facts = Path("/proc/cpuinfo")
    if facts.exists():
        lines = facts.read_text("utf-8", "replace").splitlines()
        said += next((line for line in lines if line.startswith(("flags", "Features"))), "")
    return hashlib.sha256(said.encode()).hexdigest()[:12]


def _forget_oldest(folder: Path) -> None:
    """Down to half of what may be kept, once there is more."""
    files = [(file.stat(), file) for file in folder.iterdir()]
    size = sum(about.st_size for about, _ in files)
    least = MOST / 2 if size > MOST else MOST
    for about, file in sorted(files, key=lambda one: one[0].st_mtime):
        if size <= least:
            return
        file.unlink(missing_ok=True)
        size -= about.st_size
