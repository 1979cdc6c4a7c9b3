"""Files that are complete or not there: written beside, then given the name."""

import contextlib
import csv
import os
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
