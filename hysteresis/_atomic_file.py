"""Files that are complete or not there: written beside, then given the name."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def atomic_file(
    file: Path, *, durable: bool = False, previous: Path | None = None
) -> Iterator[Path]:
    """The path of a temporary file beside `file`, which replaces it when the block ends.

        with atomic_file(folder / "fit.json") as new:
            new.write_text(text)

    A reader finds the old file or the new one, whole. If the block raises, the old file stays and the
    temporary one is removed.

    **Arguments:**

    - `durable`: wait until the disk holds the file, so that it survives a power cut too. That takes
      milliseconds, so it is for checkpoints and not for every file.
    - `previous`: where the old file is kept.
    """
    new = file.with_name(f"{file.stem}.new{file.suffix}")
    try:
        yield new
        if durable:
            _synchronise(new)
        if previous is not None and file.exists():
            os.replace(file, previous)
        os.replace(new, file)
    except BaseException:
        new.unlink(missing_ok=True)
        raise
    if durable and os.name == "posix":  # Windows cannot open a folder to synchronise its names.
        _synchronise(file.parent)


def _synchronise(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY if path.is_dir() else os.O_RDWR)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
