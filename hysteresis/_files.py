"""Files that are complete or not there: written beside, then given the name."""

import contextlib
import csv
import hashlib
import os
import platform
import re
import stat
import threading
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ._errors import InputError

_FORGOTTEN = 3600.0
"""Seconds after which a file that a killed process left beside is removed."""


@contextmanager
def atomic_file(file: Path, *, durable: bool = False) -> Iterator[Path]:
    """The path of a temporary file beside `file`, which replaces it in the end. Its folder is made.

        with atomic_file(folder / "fit.json") as new:
            new.write_text(text)

    A reader finds the old file or the new one, whole. If the block raises, the old file stays and the
    temporary one is removed. Of two writers the later one's file stays, whole too.

    **Arguments:**

    - `durable`: wait until the disk holds the file, so that it survives a power cut too. That takes
      milliseconds, so it is for checkpoints and not for every file.
    """
    file.parent.mkdir(parents=True, exist_ok=True)
    _forget(file)
    mine = f"{os.getpid()}-{threading.get_native_id()}"
    new = file.with_name(f"{file.stem}.new-{mine}{file.suffix}")
    try:
        with naming(file, new):
            yield new
            if durable:
                _synchronise(new)
            os.replace(new, file)
    except BaseException:
        new.unlink(missing_ok=True)
        raise
    if durable and os.name == "posix":  # Windows cannot open a folder to synchronise its names.
        _synchronise(file.parent)


@contextmanager
def naming(file: Path, beside: Path) -> Iterator[None]:
    """An error of the system names the file that is asked for; one of a full disk names none."""
    try:
        yield
    except OSError as error:
        if str(error.filename or beside).startswith(str(beside)):
            error.filename = str(file)
        raise


def write_whole(file: Path, content: str | bytes) -> None:
    """Write a file, whole or not at all: text as UTF-8, its line ends as they are.

    Half a character, as the name of a file may hold, is written as an escape.
    """
    with atomic_file(file) as new:
        raw = content.encode("utf-8", "backslashreplace") if isinstance(content, str) else content
        new.write_bytes(raw)


def write_table(file: Path, header: Iterable[Any], rows: Iterable[Iterable[Any]]) -> None:
    """Write a table as CSV, whole or not at all; half a character is written as an escape."""
    how: Any = {"newline": "", "encoding": "utf-8", "errors": "backslashreplace"}
    with atomic_file(file) as new, new.open("w", **how) as handle:
        csv.writer(handle).writerows([header, *rows])


def write_figure(figure: Any, file: Path, **how: Any) -> None:
    """Write a figure of matplotlib's, whole or not at all, in the format of the file's name."""
    with atomic_file(file) as new:
        figure.savefig(new, **how)


@contextmanager
def telling(file: Path, fix: str = "") -> Iterator[None]:
    """What the block writes; raises `InputError` `cannot-write` where the system refuses it."""
    try:
        yield
    except OSError as error:
        blocked = isinstance(error, FileExistsError | NotADirectoryError)
        why = "a file is where a folder is needed" if blocked else error.strerror
        said = f"{file.name} cannot be written: {why}."
        raise InputError("cannot-write", said, place=str(file.parent), fix=fix) from error


def _forget(file: Path) -> None:
    """Remove what killed processes have left beside a file long ago."""
    with contextlib.suppress(OSError):
        for old in file.parent.iterdir():
            beside = old.name.startswith(f"{file.stem}.new-") and old.suffix == file.suffix
            if beside and abs(time.time() - old.stat().st_mtime) > _FORGOTTEN:
                old.unlink()


def _synchronise(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY if path.is_dir() else os.O_RDWR)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


# The user's own folder for compiled programs.
#
# Who can write there decides what is run. So it is for this user alone: a folder that is a link, belongs
# to somebody else or can be written by others is neither read nor written.


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
