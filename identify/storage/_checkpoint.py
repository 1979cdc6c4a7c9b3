"""Work in progress in a file, so that a run that is killed at any moment loses a few seconds of work."""

import hashlib
import io
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np

from hysteresis import InputError
from hysteresis._files import atomic_file
from hysteresis._limits import damage_told, load_arrays, parse_json

FORMAT = 2
APART = 10
"""Times as long as a write takes, between two of them: large files are written less often."""


class Work(NamedTuple):
    """What messages say of work that is kept.

    - `what`: a noun in the plural. `done`: what was done, as in "the chains were drawn". `unit`: what is
      counted. `again`: how to go on after the disk was full; `anew`: how to begin from the start.
    """

    what: str
    done: str
    unit: str
    again: str
    anew: str


CHAINS = Work(
    "chains", "the chains were drawn", "steps",
    "make room, then resume: hysid sample DIR --resume (in Python resume=True).",
    "sample from the beginning, without --resume but with --overwrite.",
)  # fmt: skip


@dataclass
class Checkpoint:
    """An .npz without pickles, replaced as a whole: a kill at any moment leaves one complete file.

    - `file`: its name; None keeps nothing.
    - `identity`: what must be the same for a run to resume bit for bit: a digest or a few words each.
    - `resume`: continue what the file holds. `every`: seconds between two writes, or more if a write takes
      long.
    - `said`: notes for the user about what was read.
    """

    file: Path | None
    identity: Mapping[str, str] = field(default_factory=dict)
    resume: bool = False
    every: float = 10.0
    said: list[str] = field(default_factory=list)
    work: Work = CHAINS
    _safe: int = 0
    _write_seconds: float = 0.0

    def is_due(self, since: float) -> bool:
        """Whether to write again, `since` seconds after the last write."""
        return since >= max(self.every, APART * self._write_seconds)

    def write(self, arrays: Mapping[str, np.ndarray], done: int) -> None:
        """Keep what `done` steps made. Raises `InputError` if it cannot be written; the old file stays."""
        if self.file is None:
            return
        words = {**self.identity, "format": FORMAT, "done": done}
        words["checksum"] = digest(*arrays.values())
        packed, begin = io.BytesIO(), perf_counter()
        np.savez(packed, words=np.array(json.dumps(words)), **arrays)  # type: ignore[arg-type]
        try:
            # Durable: a file cut off in mid-write cannot be read, and a power cut is one way to be killed.
            with atomic_file(self.file, durable=True) as new:
                new.write_bytes(packed.getvalue())
        except OSError as error:
            raise InputError(
                "cannot-write",
                f"the {self.work.what} cannot be written: {error.strerror or error}."
                f" {self._safe:,} {self.work.unit} are safe, of {done:,}.",
                place=str(self.file),
                cause="the disk or a quota is full, or the folder may not be written to.",
                fix=self.work.again,
            ) from error
        self._write_seconds, self._safe = perf_counter() - begin, done

    def read(self) -> dict[str, np.ndarray] | None:
        """The arrays to resume with; None without `resume`, or if nothing was kept yet.

        Raises `InputError` if they belong to another run, or cannot be read.
        """
        if self.file is None or not self.resume:
            return None
        if not self.file.exists():
            self.said.append(
                f"no {self.work.what} were kept in {self.file.name}, so the run began from the start."
            )
            return None
        with damage_told("the checkpoint", self.file, self.work.anew):
            arrays = load_arrays(self.file)
            words = parse_json(str(arrays.pop("words")))
            if words.get("format") != FORMAT or words["checksum"] != digest(*arrays.values()):
                raise ValueError("its format or its checksum does not agree")
            self._safe = int(words["done"])
        self._check_identity(words)
        return arrays

    def check_length(self, asked: int | None, done: int) -> None:
        """Raise `InputError` if more steps were kept than are asked for, because none are thrown away."""
        if asked is not None and done > asked:
            raise InputError(
                "more-steps-kept",
                f"{done:,} {self.work.unit} were kept already, and {asked:,} are asked for.",
                place=str(self.file),
                cause=f"{self.work.unit} count from the beginning, those of before included.",
                fix=f"ask for at least {done:,}, or {self.work.anew}",
            )

    def _check_identity(self, kept: Mapping[str, Any]) -> None:
        """Few words are shown, digests are not."""
        if other := [name for name, own in self.identity.items() if kept.get(name) != own]:
            told = [
                f"{name} ({kept.get(name)}, now {own})"
                if len(own := self.identity[name]) != 16 or " " in own
                else name
                for name in other
            ]
            raise InputError(
                "other-checkpoint",
                f"{self.work.done} with another {', another '.join(told)}.",
                place=str(self.file),
                cause="the fit was made again, or data or settings have changed since.",
                fix=f"give the options of then, or another file, or {self.work.anew}",
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
