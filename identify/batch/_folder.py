"""The result of many fits, and the folder in which they are saved."""

import csv
import hashlib
import io
import json
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path, PurePosixPath
from typing import Any, NamedTuple

from hysteresis import InputError
from hysteresis._files import write_whole
from hysteresis._format import plain
from hysteresis._limits import damage_told
from hysteresis._precision import in_this_precision

from ..files._fit_folder import OF_EARLIER, load, save, summary, to_json, write_fit
from ..results._fit_result import FitResult
from ..storage._checkpoint import APART
from ..storage._file_set import check_free, read_json, write_json, write_set

SCHEMA = 1
EVERY = 1.0
"""Seconds between two writings of batch.json and batch.csv."""


class Kept(NamedTuple):
    """One fit: its row of the table, and the fit itself, which is built or read on demand."""

    row: Callable[[], dict[str, Any]]
    fit: Callable[[], FitResult]


class Fits(Mapping[str, FitResult]):
    """Fits by name. Each is built, or read from its folder, on demand."""

    def __init__(self, kept: Mapping[str, Kept]):
        self._kept = kept

    def __getitem__(self, name: str) -> FitResult:
        return self._kept[name].fit()

    def __iter__(self) -> Iterator[str]:
        return iter(self._kept)

    def __len__(self) -> int:
        return len(self._kept)


@dataclass(frozen=True)
class Batch:
    """Fits of many records; iterates over (name, fit).

    - `failed`: why the others were not fitted, by name.
    - `skipped`: names of those that an earlier call had fitted already.
    """

    kept: dict[str, Kept] = field(default_factory=dict, repr=False)
    failed: dict[str, InputError] = field(default_factory=dict)
    skipped: list[str] = field(default_factory=list)

    @property
    def fits(self) -> Fits:
        """The fits by name."""
        return Fits(self.kept)

    def __iter__(self) -> Iterator[tuple[str, FitResult]]:
        return iter(self.fits.items())

    def __len__(self) -> int:
        return len(self.kept)

    def table(self) -> list[dict[str, Any]]:
        """A row of plain data for each fit, then one for each failure: name, model, trusted, errors on the
        training and the test rows, noise, every parameter with its error and status; or what went wrong."""
        rows = [{"name": name, **kept.row()} for name, kept in self.kept.items()]
        return rows + [{"name": name, "error": str(e)} for name, e in self.failed.items()]


def row_of(fit: Mapping[str, Any]) -> dict[str, Any]:
    """A row of the table, from the `summary` of a fit or from fit.json."""
    test = fit["metrics"]["test"] or {}
    row = {
        "model": fit["model"], "trusted": fit["trusted"], "verdict": fit["verdict"]["level"],
        "rmse": fit["metrics"]["train"]["rmse"],
        "nrmse_percent": fit["metrics"]["train"]["nrmse_percent"],
        "test_nrmse_percent": test.get("nrmse_percent"),
        "sigma": fit["noise"]["sigma"], "correlation_time": fit["noise"]["correlation_time"],
    }  # fmt: skip
    for p in fit["parameters"]:
        row |= parameter_cells(p["name"], p["value"], p["stderr"], p["status"])
    return row


_names: dict[tuple[str, ...], tuple[str, ...]] = {}


def _compact(row: dict[str, Any]) -> Callable[[], dict[str, Any]]:
    """A row, kept in a kilobyte: rows of the same columns share their names, and words are kept once."""
    names = _names.setdefault(tuple(row), tuple(row))
    cells = tuple(sys.intern(x) if isinstance(x, str) else x for x in row.values())
    return lambda: dict(zip(names, cells, strict=True))


def parameter_cells(name: str, value: Any, stderr: Any, status: str) -> dict[str, Any]:
    """The cells of one parameter in a row."""
    return {name: value, f"{name} stderr": stderr, f"{name} status": status}


def digest(*parts: Any) -> str:
    """SHA-256 of plain data."""
    return hashlib.sha256(json.dumps(plain(parts), sort_keys=True).encode()).hexdigest()


class Folder:
    """Where a batch is kept: a folder for each fit, and batch.json and batch.csv beside them.

    Everything is written whole or not at all, so a batch that was killed goes on where it stopped. With
    `resume` the tables go on listing the fits of earlier batches that are there still.

    Raises `InputError` where the folder holds a batch with other settings, unless it may be written over.
    """

    def __init__(self, place: Path, settings: str, extra: Mapping[str, Any], resume: bool):
        self.place, self.settings, self.extra, self.resume = place, settings, extra, resume
        self._written, self._took = time.monotonic(), 0.0
        check_free(place, overwrite=False)
        place.mkdir(parents=True, exist_ok=True)
        file = place / "batch.json"
        before = read_json(file) if resume and file.exists() else {}
        if before and before.get("settings") != settings:
            raise InputError(
                "other-settings",
                "results of a batch with another configuration are there, and were left as they are.",
                place=str(place),
                fix="name another folder (--out DIR), or do all of it anew (--no-resume).",
            )
        with damage_told("the table", file, "do all of it anew (--no-resume)."):
            rows = {row["name"]: row for row in before.get("fits", ())}
            self._before = {k: row for k, row in rows.items() if (place / k / "fit.json").is_file()}

    def held(self, name: str, digest: str) -> Kept | None:
        """The fit of the same data with the same settings, where it is there already.

        Raises `InputError` for a name that leads elsewhere, and for a fit that is no part of a batch.
        """
        parts = PurePosixPath(name).parts
        if not parts or ".." in parts or name.startswith(("/", ".")) or "\\" in name:
            raise InputError("bad-name", f"{name!r} is no name of a folder.")
        folder = self.place / name
        if not self.resume or not (folder / "fit.json").is_file():
            return None
        document = read_json(folder / "fit.json")
        if "batch" not in document:
            check_free(folder, overwrite=False)
        if document["batch"] != {"digest": digest}:
            return None
        return Kept(_compact(row_of(document)), in_this_precision(partial(load, folder)))

    def put(self, name: str, fit: FitResult | Mapping[str, bytes], digest: str) -> Kept:
        """Write a fit, or the files of one, to its folder."""
        folder, extra = self.place / name, {**self.extra, "batch": {"digest": digest}}
        if isinstance(fit, FitResult):
            document = write_fit(fit, folder, to_json(fit), overwrite=True, extra=extra)
        else:
            document = json.loads(fit["fit.json"]) | extra
            files = {name: fit[name] for name in document["files"]}
            document = write_set(folder, "fit.json", document, files, remove=OF_EARLIER)
        return Kept(_compact(row_of(document)), in_this_precision(partial(load, folder)))

    def write(self, batch: Batch, seconds: float, finished: bool, at_once: bool = False) -> None:
        """batch.json and batch.csv, now and then on the way, and `at_once` at the end."""
        if not at_once and time.monotonic() < self._written + max(EVERY, APART * self._took):
            return
        begin, rows = time.monotonic(), batch.table()
        names, count = {row["name"] for row in rows}, len(batch)
        rows[count:count] = before = [row for k, row in self._before.items() if k not in names]
        document = {
            "schema": SCHEMA, "settings": self.settings, "finished": finished,
            "fitted": len(batch), "skipped": len(batch.skipped),
            "failed": {name: str(error) for name, error in batch.failed.items()},
            "seconds": round(seconds, 3), **self.extra, "fits": rows[: count + len(before)],
        }  # fmt: skip
        write_json(self.place / "batch.json", document)
        write_whole(self.place / "batch.csv", csv_of(rows))
        self._written = time.monotonic()
        self._took = self._written - begin


def csv_of(rows: list[dict[str, Any]]) -> str:
    """A CSV table with every column that occurs in any row."""
    columns = list(dict.fromkeys(name for row in rows for name in row))
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, columns, restval="")
    writer.writeheader()
    writer.writerows({k: "" if v is None else v for k, v in plain(row).items()} for row in rows)
    return text.getvalue()


def files_of(fit: FitResult) -> dict[str, bytes]:
    """The files of a saved fit, which is how fits travel between processes: no JAX array is pickled."""
    with tempfile.TemporaryDirectory() as folder:
        save(fit, folder)
        return {file.name: file.read_bytes() for file in Path(folder).iterdir()}


def held_in_memory(fit: FitResult | Mapping[str, bytes]) -> Kept:
    """A fit that is kept in memory, without a folder."""
    if isinstance(fit, FitResult):
        return Kept(in_this_precision(lambda: row_of(plain(summary(fit)))), lambda: fit)

    def opened() -> FitResult:
        with tempfile.TemporaryDirectory() as folder:
            for name, content in fit.items():
                (Path(folder) / name).write_bytes(content)
            return load(folder)

    return Kept(lambda: row_of(json.loads(fit["fit.json"])), in_this_precision(opened))
