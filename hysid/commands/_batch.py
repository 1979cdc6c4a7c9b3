"""The job behind `hysid batch`: a fit of every file, in turn, over processes, or over a Dask cluster."""

import glob
import os
import threading
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import get_context, parent_process
from pathlib import Path
from typing import Any

import identify
from hysteresis import InputError

from .._packages import check_extra
from ..intake._creep_fits import motion_options, step_options
from ..intake._folders import check_writable, folder_names
from ..intake._selection import Selection, all_of
from ._asked import Batch
from ._console import Done, log

PATIENCE = 5
"""Seconds to wait for a scheduler."""


def run(asked: Batch) -> Done:
    """Fit every file that the pattern names, each to a folder of its own below `out`.

    Raises `InputError` where no file is found, none can be fitted, or the scheduler does not answer.
    """
    try:
        document = _fitted(asked, asked.out)
    except KeyboardInterrupt:
        if (table := asked.out / "batch.csv").is_file():
            log(f"Fits so far: {table}. The same command with --resume fits the other files.")
        raise
    before = f" ({document['skipped']} of them by an earlier run)" if document["skipped"] else ""
    lines = [f"{document['fitted']} fitted{before}, {len(document['failed'])} failed."]
    lines += [f"{name}: {why}" for name, why in document["failed"].items()]
    return Done(document, [*lines, f"Table: {document['file']}"])


def _fitted(asked: Batch, out: Path) -> dict[str, Any]:
    pattern, selection = asked.pattern, Selection(**asked.fit.selection)
    options, function = asked.fit.of_identify, identify.fit
    files = [Path(name) for name in sorted(glob.glob(pattern, recursive=True))]
    files = [file for file in files if file.is_file()]
    if not files:
        raise InputError(
            "file-not-found",
            "No file matches this pattern.",
            place=pattern,
            cause="A typing error in the pattern, or another current folder.",
            fix="Put the pattern in quotation marks, as in 'data/*.csv'; ** matches folders at any depth.",
        )
    check_writable(out)
    if selection.is_step:
        function, options = identify.fit_step, step_options(options)
    else:
        options = motion_options(options)
    with _workers(asked.scheduler, asked.jobs) as executor:
        found = identify.fit_many(
            _Files(files, selection), executor=executor, out=out, resume=asked.resume, progress=log,
            extra={"selection": selection.as_json()}, function=function, **options,
        )  # fmt: skip
    if not found.kept:
        raise all_of(found.failed)
    return {
        "fitted": len(found),
        "skipped": len(found.skipped),
        "failed": {name: str(error) for name, error in found.failed.items()},
        "fits": found.table()[: len(found)],
        "file": str(out / "batch.csv"),
    }


@dataclass(frozen=True)
class _Files:
    """Records of files by the names of their folders: read when their turn comes."""

    files: list[Path]
    selection: Selection

    def __length_hint__(self) -> int:
        """How many records there are, where each file has one."""
        return 0 if self.selection.each else len(self.files)

    def items(self) -> Iterator[tuple[str, Any]]:
        """Name, and record with what is held out, or why there is none."""
        for name, file in zip(_names(self.files), self.files, strict=True):
            try:
                records, faults = self.selection.records(self.selection.read(file))
            except InputError as error:
                yield name, error
                continue
            folders = folder_names([*records, *faults])
            for value, found in {**records, **faults}.items():
                yield f"{name}/{folders[value]}" if value else name, found


def _names(files: list[Path]) -> list[str]:
    """A folder's name for each file: its own, with its folders' where several have the same."""
    stems = Counter(file.stem.casefold() for file in files)
    shared = Path(os.path.commonpath([file.absolute().parent for file in files]))
    names: dict[str, str] = {}  # a name without regard to case, as some file systems take it
    for file in files:
        name = file.stem
        if stems[name.casefold()] > 1:
            name = "-".join(file.absolute().relative_to(shared).with_suffix("").parts)
        folder = next(iter(folder_names([name]).values())).lstrip(".") or "_"
        while folder.casefold() in names:
            folder += "_"
        names[folder.casefold()] = folder
    return list(names.values())


@contextmanager
def _workers(scheduler: str | None, jobs: int) -> Iterator[Any]:
    """What `fit_many` takes for an executor."""
    if scheduler is None:
        yield None if jobs == 1 else lambda: _pool(jobs)
        return
    check_extra("cluster", "distributed")
    from distributed import Client  # late: it is of an extra

    try:
        client = Client(scheduler, timeout=PATIENCE)
    except (OSError, ValueError, RuntimeError) as error:
        raise InputError(
            "no-scheduler",
            f"No Dask scheduler answers there within {PATIENCE} s ({type(error).__name__}).",
            place=f"--scheduler {scheduler}",
            cause="It is not running, or it has another address: tcp://HOST:8786.",
            fix="Start one (dask scheduler), or spread the files over processes (--jobs N).",
        ) from None
    with client:
        yield client.get_executor(retries=2, pure=False)


def _pool(jobs: int) -> ProcessPoolExecutor:
    # Forked processes inherit locks of JAX's threads; new ones take ./select.py for Python's own module.
    os.environ["PYTHONSAFEPATH"] = "1"
    return ProcessPoolExecutor(jobs, get_context("spawn"), initializer=_as_worker)


def _as_worker() -> None:
    """Processes side by side each keep to one thread, said before JAX starts its own; none outlives us."""
    threading.Thread(target=_end_with_parent, daemon=True).start()
    flags = os.environ.get("XLA_FLAGS", "")
    os.environ["XLA_FLAGS"] = f"{flags} --xla_cpu_multi_thread_eigen=false"
    for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ[variable] = "1"


def _end_with_parent() -> None:
    """A killed process leaves its workers waiting for work for ever."""
    if (parent := parent_process()) is not None:
        parent.join()
        os._exit(1)
