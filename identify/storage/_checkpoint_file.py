"""What all checkpoints share: when to write, how to write without loss, whose work the file holds."""

import hashlib
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from hysteresis import InputError
from hysteresis._atomic_file import atomic_file

WRITING_SHARE = 0.1
"""The largest part of the time that is spent on writing; a large checkpoint is written less often."""


@dataclass
class CheckpointFile:
    """A file that holds work in progress, so that a killed run can be resumed.

    - `file`: its name; None keeps nothing.
    - `every`: seconds between two writes, or more if a write takes long.
    - `keeps_previous`: whether the checkpoint before the last one is kept, as NAME.previous.SUFFIX.
    """

    file: Path | None
    every: float = 10.0
    keeps_previous: bool = False
    _write_seconds: float = 0.0

    @property
    def previous(self) -> Path:
        """The name under which the checkpoint before the last one is kept."""
        assert self.file is not None
        return self.file.with_suffix(f".previous{self.file.suffix}")

    def is_due(self, since: float) -> bool:
        """Whether to write again, `since` seconds after the last write."""
        return since >= max(self.every, self._write_seconds / WRITING_SHARE)

    def write(self, content: bytes, what: str, *, safe: str = "", fix: str) -> None:
        """Replace the checkpoint by `content`.

        Raises `InputError` `cannot-write` if the disk refuses; the old checkpoint stays. `what`
        (a noun in the plural or singular), `safe` (a sentence) and `fix` make the message.
        """
        if self.file is None:
            return
        begin = perf_counter()
        try:
            # Durable: a file cut off in mid-write cannot be read, and a power cut is one way to be killed.
            previous = self.previous if self.keeps_previous else None
            with atomic_file(self.file, durable=True, previous=previous) as new:
                new.write_bytes(content)
        except OSError as error:
            raise InputError(
                "cannot-write",
                f"{what} cannot be written: {error.strerror or error}.{safe and ' '}{safe}",
                place=str(self.file),
                cause="the disk or a quota is full, or the folder may not be written to.",
                fix=fix,
            ) from error
        self._write_seconds = perf_counter() - begin


def check_identity(
    file: Path,
    own: Mapping[str, str],
    kept: Mapping[str, Any],
    *,
    verb: str,
    fix: str,
    shown: Collection[str] = (),
) -> None:
    """Raise `InputError` `other-checkpoint` if a checkpoint belongs to other work than this.

    **Arguments:**

    - `own`, `kept`: what must be the same for a run to resume bit for bit: a digest or a few words each.
    - `verb`: what was done with it, as in "the chains were drawn".
    - `shown`: entries whose values a reader can compare; the others are digests.
    """
    other = [name for name in own if kept.get(name) != own[name]]
    if not other:
        return
    differences = [
        f"{name} ({kept.get(name)}, now {own[name]})" if name in shown else name for name in other
    ]
    raise InputError(
        "other-checkpoint",
        f"{verb} with another {', another '.join(differences)}.",
        place=str(file),
        cause="the fit was made again, or data or settings have changed since.",
        fix=fix,
    )


def digest(*parts: Any) -> str:
    """A short digest of arrays, and of the `repr` of everything else."""
    made = hashlib.sha256()
    for part in parts:
        if isinstance(part, np.ndarray):
            made.update(f"{part.dtype.str}{part.shape}".encode())
            made.update(np.ascontiguousarray(part).tobytes())
        else:
            made.update(repr(part).encode())
    return made.hexdigest()[:16]
