"""The user's own folder for compiled programs.

Who can write there decides what is run. So it is for this user alone: a folder that is a link, belongs
to somebody else or can be written by others is neither read nor written.
"""

import contextlib
import hashlib
import os
import platform
import re
import stat
from pathlib import Path


def own_folder(name: str) -> tuple[Path | None, str]:
    """A folder of this name and this kind of processor, made where it is missing; or None, and why, where
    there is anything to say."""
    try:
        cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
        folder = cache / "hysid" / f"{name}-{_processor()}"
        cache.mkdir(parents=True, exist_ok=True)
        if fault := _shared(cache) or _not_own(folder.parent) or _not_own(folder):
            return None, f"Compiled programs are not kept: {fault}"
    except (OSError, RuntimeError):
        return None, ""
    return folder, ""


def forget_oldest(folder: Path, most: int, named: re.Pattern[str]) -> None:
    """Down to half of what may be kept, in bytes, once there is more; only files with such names."""
    files = [
        (about, file)
        for file in folder.rglob("*")
        if named.fullmatch(file.name) and stat.S_ISREG((about := file.lstat()).st_mode)
    ]
    size = sum(about.st_size for about, _ in files)
    least = most / 2 if size > most else most
    for about, file in sorted(files, key=lambda one: one[0].st_mtime):
        if size <= least:
            return
        file.unlink(missing_ok=True)
        size -= about.st_size


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
