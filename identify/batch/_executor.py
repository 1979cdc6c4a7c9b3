"""Units of work on any executor; the units of a worker that died are run again on another one."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    wait,
)
from typing import Any, NamedTuple

from hysteresis import InputError

from .._levels import TRIES

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
