"""`fit_many`: fit many records, side by side on one machine or distributed over an executor."""

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import fields, replace
from functools import cached_property
from itertools import count
from operator import length_hint
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import equinox as eqx
import numpy as np

from hysteresis import AbstractModel, InputError, Record
from hysteresis._note import ProgressNote
from hysteresis._precision import in_this_precision, is_double
from hysteresis._serialisation import described

from ..fitting._candidate import Candidate
from ..fitting._candidates import Asked, candidates
from ..fitting._fit import fit
from ..fitting._verdict import USABLE
from ..parameters._settings import numbers_of, with_settings
from ..results._fit_result import FitResult
from ._executor import MakesExecutor, Unit, done_by
from ._folder import (
    Batch,
    Folder,
    Kept,
    digest,
    held_in_memory,
    parameter_cells,
)
from ._side_by_side import (
    Problem,
    Solved,
    errors_and_statuses,
    kin,
    result,
    side_by_side,
    structure,
    unfit,
)
from ._worker import HOME, Fault, fit_alone, fit_together, packed, with_templates

Item = Record | tuple[Record, Record | None]
"""A record to fit, or a pair of it and the record to test the fit on."""

SIDE_BY_SIDE = ("LinearSponge", "Burgers", "FoamCurve", "BoucWen")
"""Names of models that `fit_many` fits by one compiled `vmap`."""


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
    chunk: int | None = None,
    starts: int = 32,
    seed: int = 0,
    conditioning: str = "keep",
    clocks: str = "keep",
    noise: str = "gaussian",
    out: str | Path | None = None,
    resume: bool = True,
    progress: Callable[[str], None] | None = None,
    function: Callable[..., FitResult] = fit,
    extra: Mapping[str, Any] | None = None,
    **options: Any,
) -> Batch:
    """Fit one model to each of many records. One that cannot be fitted is named and stops nothing.

    Records with the same number of rows and the same starts of their sequences are fitted side by side by
    one compiled `vmap`, where the model is one of few parameters (`SIDE_BY_SIDE`, or a model without relays
    to start from), nothing is held out, and `conditioning`, `clocks` and `noise` are as above. That gives
    what `fit` gives with these options, to the solver's tolerance, but for what it leaves out: no parts of
    a record are held out from its own fit, so `score` is NaN and `blocks` None. A fit is put together from
    the arrays when it is asked for, its residuals and verdict with it.

    With other options and models every record has a `fit` of its own, in turn or spread over the executor.

    **Arguments:**

    - `records`: by name, or in turn; a pair is a record to fit and one to judge on. `names`: of records
      without; by default their numbers.
    - `executor`: a `concurrent.futures.Executor`, of threads, of processes, or Dask's
      `Client.get_executor()`; or a function that makes one, and makes it anew where a worker that died
      broke it. Records and fits travel as plain arrays. None: all in this thread.
    - `chunk`: how many records are fitted side by side; by default as many as 256 MB hold, 1024 at most.
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
        own = {"conditioning": conditioning, "clocks": clocks, "noise": noise}
        options |= own | {"starts": starts, "seed": seed, "model": model}
    run = _Run(function, options, chunk, progress or (lambda _: None))
    if out is not None:
        run.folder = Folder(Path(out), run.settings(extra or {}), extra or {}, resume)
    run.total = length_hint(records)
    if isinstance(records, Named):
        return run.over(records.items(), executor)
    return run.over(zip(_names(names), records, strict=False), executor)


def _names(names: Iterable[str] | None) -> Iterator[str]:
    return map(str, count()) if names is None else iter(names)


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
        chunk: int | None,
        say: Callable[[str], None],
    ):
        self.function, self.options, self.chunk, self.say = function, options, chunk, say
        self.asked = candidates(options["model"]) if function is fit else ()
        self.only: Candidate | None = next(iter(self.asked)) if len(self.asked) == 1 else None
        self.batch, self.begin = Batch(), time.perf_counter()
        self.digests: dict[str, str] = {}
        self.order: list[str] = []
        self.problems: dict[str, Problem] = {}
        self.alone: list[tuple[str, Record]] = []

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
                self._take(unit, outcome)
            # Of records side by side that failed together each is tried by itself.
            alone = [self._alone(name, record, None) for name, record in self.alone]
            for unit, outcome in done_by(alone, executor if alone else None):
                self._take(unit, outcome)
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
        groups: dict[Any, dict[str, Problem]] = {}
        most: dict[Any, int] = {}
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
                if self.folder is not None and (kept := self._held(name, train, test)) is not None:
                    self.batch.kept[name] = kept
                    self.batch.skipped.append(name)
                    continue
                problem = self._problem(train) if test is None else None
            except InputError as error:
                self._fail(name, error)
                continue
            if problem is None:
                yield self._alone(name, train, test)
                continue
            key = kin(problem)
            if key not in groups:
                groups[key] = {}
                most[key] = self.chunk or side_by_side(problem, self.options["starts"])
            groups[key][name] = problem
            if len(groups[key]) == most[key]:
                yield from self._together(groups[key])
                groups[key] = {}
        for group in groups.values():
            yield from self._together(group)

    def _held(self, name: str, train: Record, test: Record | None) -> Kept | None:
        data = [train.digest(), test and test.digest()]
        assert self.folder is not None
        self.digests[name] = digest(data, self.folder.settings)
        return self.folder.held(name, self.digests[name])

    @cached_property
    def _template(self) -> tuple[AbstractModel, Any, Any] | None:
        """The model to start from, if the user gave one."""
        if self.only is None or self.only.template is None:
            return None
        start, settings = with_settings(self.only.template, self.options.get("parameters") or {})
        return start, settings, structure(start)

    @cached_property
    def _is_for_vmap(self) -> bool:
        usual = {"conditioning": "keep", "clocks": "keep", "noise": "gaussian"}
        known = {*usual, "starts", "seed", "model", "parameters", "allow_float32"}
        if self.only is None or self.function is not fit or set(self.options) - known:
            return False
        if any(self.options[name] != value for name, value in usual.items()):
            return False
        if any("prior" in said for said in (self.options.get("parameters") or {}).values()):
            return False
        if (template := self.only.template) is not None:
            return not _has_relays(template) and bool(numbers_of(template))
        return self.only.name in SIDE_BY_SIDE

    def _problem(self, record: Record) -> Problem | None:
        """The problem to fit side by side; None for a record that needs a fit of its own."""
        only = self.only
        if only is None or not self._is_for_vmap or record.channels or not record.mask.any():
            return None
        u, y = record.input[record.mask], record.output[record.mask]
        if u.min() == u.max() or y.min() == y.max():
            return None  # `fit` says what is wrong
        said = self.options.get("parameters") or {}
        if self._template is None:
            start = only.suggested(record)
            assert start is not None
            start, settings = with_settings(start, said)
            return Problem(record, start, False, settings, structure(start))
        start, settings, shape = self._template
        if record.time is None:
            only.suggested(record)  # raises where the model needs a clock
        return Problem(record, start, not said, settings, shape)

    def _alone(self, name: str, train: Record, test: Record | None) -> Unit:
        arguments = (HOME, self.function, packed(self.options), train, test, is_double())
        return Unit((name,), fit_alone, arguments)

    def _together(self, group: dict[str, Problem]) -> Iterator[Unit]:
        faults = unfit([*group.values()]) if group else {}
        names = [*group]
        for k, error in faults.items():
            self._fail(names[k], error)
        good = {name: group[name] for k, name in enumerate(names) if k not in faults}
        if good:
            self.problems |= good
            arguments = (
                with_templates(good.values(), packed),
                self.options["starts"],
                self.options["seed"],
                is_double(),
            )
            yield Unit(tuple(good), fit_together, arguments)

    def _take(self, unit: Unit, outcome: Any) -> None:
        if isinstance(outcome, Solved):
            problems = [self.problems.pop(name) for name in unit.names]
            chunk = _Chunk(problems, outcome, self.options["seed"])
            for k, name in enumerate(unit.names):
                if np.isfinite(outcome.squares[k]):
                    self._keep(name, chunk.kept(k))
                else:
                    self._fail(name, _no_start(self.options["starts"]))
        elif isinstance(outcome, Exception) and unit.function is fit_together:
            self.say(f"side by side ended in {_explained(outcome)} Each by itself, then")
            self.alone += [(name, self.problems.pop(name).record) for name in unit.names]
        elif isinstance(outcome, Exception):
            self._fail(unit.names[0], _explained(outcome))
        elif isinstance(outcome, Fault):
            self._fail(unit.names[0], InputError(*outcome[:2], **outcome.words))
        else:
            self._keep(unit.names[0], outcome)

    def _keep(self, name: str, found: Kept | FitResult | dict[str, bytes]) -> None:
        if self.folder is not None:
            fitted = found.fit() if isinstance(found, Kept) else found
            found = self.folder.put(name, fitted, self.digests[name])
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


class _Chunk:
    """Several problems that are fitted side by side."""

    def __init__(self, problems: list[Problem], solved: Solved, seed: int):
        self.problems, self.solved, self.seed = problems, solved, seed

    def kept(self, k: int) -> Kept:
        return Kept(
            in_this_precision(lambda: self.row(k)),
            in_this_precision(lambda: result(self.problems[k], self.solved, k, self.seed)),
        )

    @cached_property
    def told(self) -> tuple[np.ndarray, np.ndarray]:
        return errors_and_statuses(self.problems[0].bounds, self.solved)

    def row(self, k: int) -> dict[str, Any]:
        solved, problem = self.solved, self.problems[k]
        y = problem.record.output[problem.record.mask]
        rmse = float(np.sqrt(solved.squares[k] / solved.rows[k]))
        nrmse = 100 * rmse / float(np.ptp(y)) if np.ptp(y) > 0 else float("nan")
        good = bool(solved.converged[k]) and nrmse <= USABLE and rmse < float(np.std(y))
        row = {
            "model": type(problem.template).__name__, "trusted": good, "rmse": rmse,
            "nrmse_percent": nrmse, "sigma": solved.sigma(k), "correlation_time": 1.0,
        }  # fmt: skip
        errors, status = self.told
        for j, name in enumerate(problem.bounds.names):
            honest = float(errors[k, j]) if status[k, j] == "free" else None
            row |= parameter_cells(name, float(solved.values[k, j]), honest, str(status[k, j]))
        return row


def _no_start(starts: int) -> InputError:
    return InputError(
        "no-finite-start",
        f"from no start, {starts} of them about the one given, has the model a finite output.",
        fix="give a model to start from whose output is finite over the record.",
    )


def _explained(error: Exception) -> InputError:
    if isinstance(error, InputError):
        return error
    said = " ".join(str(error).split())[:200]
    return InputError(
        "fit-broke", f"its fit ended in {type(error).__name__}: {said}", cause="a fault of ours."
    )


def _has_relays(model: Any) -> bool:
    """Whether a model remembers turning points; what it prepares then differs in size between records."""
    if type(model).__module__.startswith("hysteresis.preisach"):
        return True
    values = [getattr(model, f.name) for f in fields(model)]
    parts = [p for v in values for p in (v if isinstance(v, tuple) else (v,))]
    return any(_has_relays(part) for part in parts if isinstance(part, eqx.Module))
