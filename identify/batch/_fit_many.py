"""`fit_many`: fit many records, in turn or distributed over an executor."""

import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    wait,
)
from dataclasses import replace
from functools import cached_property, partial
from itertools import count
from operator import length_hint
from pathlib import Path
from typing import Any, NamedTuple, Protocol, runtime_checkable
from uuid import uuid4

import jax
import jax.numpy as jnp
import numpy as np

from hysteresis import InputError, LinearSponge, Record
from hysteresis._precision import in_this_precision, is_double
from hysteresis._serialisation import described
from hysteresis._verdict import ProgressNote
from hysteresis.records._excitation import correlation

from .._levels import FEW, TRIES
from ..fitting._candidates import Asked, candidates
from ..fitting._fit import INTERRUPTED, fit
from ..fitting._verdict import USABLE
from ..noise._arithmetic import Rows
from ..parametric._maximum_likelihood import plainest
from ..parametric._standard_errors import covariance_of
from ..results._fit_result import FitResult
from ._folder import Batch, Folder, Kept, digest, files_of, held_in_memory, parameter_cells

# Units of work on any executor; the units of a worker that died are run again on another one.

WINDOW = 256
"""Units handed out at a time: enough for a large cluster, and not all records at once in memory."""

MakesExecutor = Callable[[], Executor]


class Unit(NamedTuple):
    """A plain function with arguments that can be pickled, and the name of the record it works on."""

    name: str
    function: Callable[..., Any]
    arguments: tuple[Any, ...]


def done_by(
    units: Iterable[Unit], executor: Executor | MakesExecutor | None = None
) -> Iterator[tuple[Unit, Any]]:
    """Each unit with what its function returned, in the order they end; serially without an executor.

    `units` is read as work is handed out. What a function raises stands in the place of its result. A
    unit whose worker died is done again, up to three times; a pool that broke with it is made anew where
    `executor` is a function that makes one, and what it had in hand goes on one by one, so that the unit
    that breaks pools is found and named. Executors made here are shut down here.
    """
    if executor is None:
        for unit in units:
            yield unit, _attempt(unit.function, *unit.arguments)
    elif isinstance(executor, Executor):
        yield from _spread(units, executor, None)
    else:
        yield from _spread(units, executor(), executor)


def _attempt(work: Callable[..., Any], *arguments: Any) -> Any:
    try:
        return work(*arguments)
    except (Exception, CancelledError) as error:
        return error


def _spread(
    units: Iterable[Unit], executor: Executor, make: MakesExecutor | None
) -> Iterator[tuple[Unit, Any]]:
    window = 2 * getattr(executor, "_max_workers", WINDOW // 2)
    fresh = iter(units)
    suspects: deque[tuple[Unit, int]] = deque()
    flying: dict[Future[Any], tuple[Unit, int]] = {}
    exhausted = False
    try:
        while flying or suspects or not exhausted:
            broken: list[tuple[Unit, int]] = []
            while len(flying) < (1 if suspects else window) and not broken:
                if suspects:
                    unit, tries = suspects.popleft()
                elif (unit := next(fresh, None)) is None:
                    exhausted = True
                    break
                else:
                    tries = 1
                try:
                    flying[executor.submit(unit.function, *unit.arguments)] = unit, tries
                except BrokenExecutor:
                    broken.append((unit, tries))
            # Whatever ended; of a broken pool that is everything.
            for future in wait(flying, return_when=FIRST_COMPLETED).done if flying else ():
                unit, tries = flying.pop(future)
                outcome = _attempt(future.result)
                if isinstance(outcome, BrokenExecutor):
                    broken.append((unit, tries))
                elif _is_lost(outcome) and tries < TRIES:
                    flying[executor.submit(unit.function, *unit.arguments)] = unit, tries + 1
                else:
                    yield unit, _lost(outcome) if _is_lost(outcome) else outcome
            if not broken:
                continue
            broken += flying.values()
            flying.clear()
            if make is not None:
                executor.shutdown(wait=False, cancel_futures=True)
                executor = make()
            for unit, tries in broken:
                if make is None or tries == TRIES:
                    yield unit, _lost("its pool of processes broke")
                else:
                    suspects.append((unit, tries + 1))
    finally:
        for future in flying:
            future.cancel()
        if make is not None:
            executor.shutdown(wait=True, cancel_futures=True)


def _is_lost(outcome: Any) -> bool:
    """Whether a unit was lost because its worker died; Dask has an exception type of its own for that."""
    return isinstance(outcome, CancelledError) or type(outcome).__name__ == "KilledWorker"


def _lost(why: Any) -> InputError:
    said = why if isinstance(why, str) else f"{type(why).__name__}: {why}"
    return InputError(
        "worker-lost",
        f"the process that fitted it died ({said}).",
        cause="the memory ran out, or somebody killed it.",
        fix="call again: what is done stays done; or give it more memory and fewer rows.",
    )


# Linear sponges by least squares in closed form: a row of the table in 0.1 ms, without a fit.


CORRELATION = 0.5
"""Least one with the input of a record that certainly passes `check_identifiable`."""


def line_row(record: Record, threshold: float) -> dict[str, Any] | None:
    """The row of the `LinearSponge` that has the least squares, its noise Gaussian; None where `fit` itself
    has to tell whether the record identifies one."""
    u, y = record.input[record.mask], record.output[record.mask]
    if len(u) < FEW or record.channels or record.sigma is not None:
        return None
    touched = u >= threshold
    if not correlation(record) > CORRELATION or np.ptp(u[touched]) == 0:
        return None
    J = np.column_stack([np.where(touched, u, 0.0), touched])
    values = np.linalg.lstsq(J, y, rcond=None)[0]
    residuals = J @ values - y
    none, one = np.zeros(len(u)), np.ones(len(u))
    found, _ = plainest(values, residuals, J, Rows(one > 0, none, none, none, none[:, None], one))
    errors = found.wider * np.sqrt(np.diagonal(covariance_of(found.root, 1.0)))
    rmse = float(np.sqrt(np.mean(residuals**2)))
    nrmse = 100 * rmse / float(np.ptp(y))
    row = {
        "model": "LinearSponge", "trusted": nrmse <= USABLE and rmse < float(np.std(y)), "rmse": rmse,
        "nrmse_percent": nrmse, "sigma": float(found.noise.sigma), "correlation_time": 1.0,
    }  # fmt: skip
    for name, value, error in zip(("K", "b"), values, errors, strict=True):
        row |= parameter_cells(name, float(value), float(error), "free")
    return row


# The work of one worker: one fit, in this process or another one.


HOME = uuid4().hex
"""Tells this process from others: what was fitted here need not travel."""


def fit_alone(
    home: str,
    function: Callable[..., FitResult],
    options: dict[str, Any],
    train: Record,
    test: Record | None,
    double: bool,
) -> FitResult | dict[str, bytes]:
    """Fit one record; in another process, return the files of the fit."""
    with jax.enable_x64(double):
        if home != HOME and function is fit:
            for one in candidates(options["model"]):
                described(one.template)  # raises where the files of its fit could not be loaded
        watched = {"progress": _interrupts} if function is fit else {}
        found = function(train, test=test, **watched, **unpacked(options))
        return found if home == HOME else files_of(found)


def _interrupts(line: str) -> None:
    """Ctrl-C ends the batch: a fit that it cut short is not one of its results."""
    if isinstance(line, ProgressNote) and line.code == INTERRUPTED:
        raise KeyboardInterrupt


def packed(tree: Any) -> Any:
    """Convert JAX arrays to NumPy arrays: without x64 a process would unpickle them in single precision."""
    return jax.tree.map(lambda x: np.asarray(x) if isinstance(x, jax.Array) else x, tree)


def unpacked(tree: Any) -> Any:
    return jax.tree.map(lambda x: jnp.asarray(x) if isinstance(x, np.ndarray) else x, tree)


Item = Record | tuple[Record, Record | None]
"""A record to fit, or a pair of it and the record to test the fit on."""

FOR_A_LINE: dict[str, Any] = {"conditioning": "keep", "clocks": "keep", "noise": "gaussian"}
"""With these options the fit of a linear sponge has a closed form."""


@runtime_checkable
class Named(Protocol):
    """Records by name. They are read one after the other, so they may be generated lazily."""

    def items(self) -> Iterable[tuple[str, Item | InputError]]:
        """Pairs of a name and its record, or the error that took its place."""
        ...


def fit_many(
    records: Named | Iterable[Item],
    model: Asked | Sequence[Asked] = "auto",
    *,
    names: Iterable[str] | None = None,
    executor: Executor | MakesExecutor | None = None,
    out: str | Path | None = None,
    resume: bool = True,
    progress: Callable[[str], None] | None = None,
    function: Callable[..., FitResult] = fit,
    extra: Mapping[str, Any] | None = None,
    **options: Any,
) -> Batch:
    """Fit one model to each of many records. One that cannot be fitted is named and stops nothing.

    Every record has a `fit` of its own, with the same options, in turn or spread over the executor.

    Many linear sponges are quicker: with `conditioning="keep"`, `clocks="keep"`, `noise="gaussian"`, no
    other option and no `out` the table comes from a closed form, at thousands of records a second. It has
    what `fit` finds, but neither verdict nor score. A fit of such a batch is made when it is asked for.

    **Arguments:**

    - `records`: by name, or in turn; a pair is a record to fit and one to judge on. `names`: of records
      without; by default their numbers.
    - `executor`: a `concurrent.futures.Executor`, of threads, of processes, or Dask's
      `Client.get_executor()`; or a function that makes one, and makes it anew where a worker that died
      broke it. Records and fits travel as plain arrays. None: all in this thread.
    - `out`: a folder. Each fit is saved below it as soon as it ends, batch.json and batch.csv list them,
      and with `resume` what is there of the same data and settings is not done again.
    - `progress`: called with a line of text now and then.
    - `function`: what fits one record; another than `fit` is called with the record, `test` and `options`.
    - `extra`: added to batch.json and to every fit.json.
    - all others: as in `fit`.

    Raises `InputError` if `out` holds a batch with other settings.

    **Example:**

        >>> batch = identify.fit_many({"new": record, "worn": record}, "LinearSponge", starts=2)
        >>> [(row["name"], round(row["K"], 2)) for row in batch.table()]
        [('new', 1.32), ('worn', 1.32)]
    """
    function = getattr(function, "inner", function)
    if function is fit:
        options["model"] = model
    run = _Run(function, options, progress or (lambda _: None))
    if out is not None:
        run.folder = Folder(Path(out), run.settings(extra or {}), extra or {}, resume)
    run.total = length_hint(records)
    if isinstance(records, Named):
        return run.over(records.items(), executor)
    named = map(str, count()) if names is None else names
    return run.over(zip(named, records, strict=False), executor)


class _Run:
    """One call of `fit_many`: it takes records, hands out units of work and collects fits.

    `total`: how many records there are, 0 where that is not known.
    """

    folder: Folder | None = None
    total: int = 0

    def __init__(
        self,
        function: Callable[..., FitResult],
        options: dict[str, Any],
        say: Callable[[str], None],
    ):
        self.function, self.options, self.say = function, options, say
        self.asked = candidates(options["model"]) if function is fit else ()
        self.batch, self.begin = Batch(), time.perf_counter()
        self.digests: dict[str, str] = {}
        self.order: list[str] = []

    def settings(self, extra: Mapping[str, Any]) -> str:
        """Digest of everything that determines the fit of a record."""
        plain_options: dict[str, Any] = dict(self.options)
        if self.asked:
            plain_options["model"] = [[one.name, *described(one.template)] for one in self.asked]
        return digest(self.function.__name__, plain_options, extra)

    def over(
        self,
        items: Iterable[tuple[str, Item | InputError]],
        executor: Executor | MakesExecutor | None,
    ) -> Batch:
        """Fit every record, and return the batch."""
        try:
            for unit, outcome in done_by(self._units(items), executor):
                if isinstance(outcome, Exception):
                    self._fail(unit.name, _explained(outcome))
                else:
                    self._keep(unit.name, outcome)
        except BaseException:
            self._write(finished=False)
            raise
        self._write(finished=True)
        return self._ordered()

    def _write(self, finished: bool) -> None:
        if self.folder is not None:
            seconds = time.perf_counter() - self.begin
            self.folder.write(self._ordered(), seconds, finished, at_once=True)

    def _ordered(self) -> Batch:
        batch = self.batch
        kept = {name: batch.kept[name] for name in self.order if name in batch.kept}
        failed = {name: batch.failed[name] for name in self.order if name in batch.failed}
        return replace(batch, kept=kept, failed=failed)

    def _units(self, items: Iterable[tuple[str, Item | InputError]]) -> Iterator[Unit]:
        for name, item in items:
            if name in self.digests:
                item = InputError("given-twice", f"{name} is the name of several records.")
            self.order.append(name)
            self.digests[name] = ""
            if isinstance(item, InputError):
                self._fail(name, item)
                continue
            train, test = item if isinstance(item, tuple) else (item, None)
            try:
                if self.folder is not None:
                    data = [train.digest(), test and test.digest()]
                    self.digests[name] = digest(data, self.folder.settings)
                    if (kept := self.folder.held(name, self.digests[name])) is not None:
                        self.batch.kept[name] = kept
                        self.batch.skipped.append(name)
                        continue
            except InputError as error:
                self._fail(name, error)
                continue
            if test is None and (line := self._line(train)) is not None:
                self._keep(name, line)
            else:
                arguments = (HOME, self.function, packed(self.options), train, test, is_double())
                yield Unit(name, fit_alone, arguments)

    @cached_property
    def _threshold(self) -> float | None:
        """Of the linear sponges that have a closed form, where none but these are asked for."""
        plain = {name: value for name, value in self.options.items() if name != "model"}
        asked = next(iter(self.asked), None)
        if self.folder is not None or plain != FOR_A_LINE or asked is None or len(self.asked) > 1:
            return None
        if isinstance(asked.template, LinearSponge):
            return float(asked.template.threshold)
        return -np.inf if asked.template is None and asked.kind is LinearSponge else None

    def _line(self, record: Record) -> Kept | None:
        if self._threshold is None or (row := line_row(record, self._threshold)) is None:
            return None
        return Kept(lambda: dict(row), in_this_precision(partial(fit, record, **self.options)))

    def _keep(self, name: str, found: Kept | FitResult | dict[str, bytes]) -> None:
        if self.folder is not None:
            assert not isinstance(found, Kept)
            found = self.folder.put(name, found, self.digests[name])
        self.batch.kept[name] = found if isinstance(found, Kept) else held_in_memory(found)
        self._went(name, "")

    def _fail(self, name: str, error: InputError) -> None:
        self.batch.failed[name] = error
        self._went(name, f": not fitted. {error}")

    def _went(self, name: str, what: str) -> None:
        done = len(self.batch.kept) + len(self.batch.failed)
        of = f" of {self.total}" if self.total else ""
        said = f"{done}{of}: {name}{what}"
        self.say(ProgressNote("record", said, done, self.total) if self.total else said)
        if self.folder is not None:
            self.folder.write(self.batch, time.perf_counter() - self.begin, finished=False)


def _explained(error: Exception) -> InputError:
    if isinstance(error, InputError):
        return error
    said = " ".join(str(error).split())[:200]
    return InputError(
        "fit-broke", f"its fit ended in {type(error).__name__}: {said}", cause="a fault of ours."
    )
