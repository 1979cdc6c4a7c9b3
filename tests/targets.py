"""Models that the targets of `hysid export --to` are tried with, and the C99 reference of each."""

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from compensate import Quantity, calibrated, invert
from compensate.export._export import Origin, Program
from compensate.export.targets._export_to import write_to
from hysteresis import (
    AbstractModel,
    Burgers,
    DuhemOperator,
    ModulatedStops,
    PrandtlIshlinskii,
    Preisach,
    Record,
    Softening,
    Sum,
)
from hysteresis.preisach import GridDensity
from tests.c_harness import Compiled
from tests.problems import random_histories
from tests.test_compensate.test_inverses.test_conditioned import model as conditioned
from tests.test_compensate.test_inverses.test_conditioned import walk

ROWS = 300
ORIGIN = Origin("CAUTION", ("flat",), "2024-05-03", 64 * "a")


def grid(cells: int = 20, low: float = 0.0, high: float = 1.0) -> Preisach:
    """A grid whose masses are all positive, with a reversible part."""
    rng = np.random.default_rng(0)
    weights = np.tril(rng.uniform(0.1, 1.0, (cells, cells)))
    reversible = rng.uniform(0.1, 0.5, cells) / 6
    return Preisach(GridDensity(low, high, weights / weights.sum()), reversible)


def _rated() -> tuple[AbstractModel, np.ndarray, np.ndarray]:
    t = np.cumsum(np.random.default_rng(1).uniform(0.01, 0.05, ROWS))
    return Burgers(2.0, 40.0, 1.0, 5.0), t, 3 * np.sin(t) + t / 5


def _relays() -> tuple[AbstractModel, np.ndarray, np.ndarray]:
    u = random_histories(np.random.default_rng(2), 0.0, 1.0, (1, ROWS))[0]
    return grid(7), 0.02 * np.arange(ROWS), u


def _conditioned() -> tuple[AbstractModel, np.ndarray, np.ndarray]:
    u, c = walk(80)
    return conditioned(), 0.02 * np.arange(80), np.column_stack([u, c])


def _plays() -> tuple[AbstractModel, np.ndarray, np.ndarray]:
    model = PrandtlIshlinskii(np.array([0.1, 0.2, 0.4, 0.7]), np.array([0.4, 0.3, 0.2, 0.1]), 0.5)
    u = random_histories(np.random.default_rng(2), 0.0, 1.0, (1, ROWS))[0]
    return model, 0.02 * np.arange(ROWS), u


def _duhem() -> tuple[AbstractModel, np.ndarray, np.ndarray]:
    model = DuhemOperator([2.0, 1.0, 0.5], [0.5, 1.0, 2.0], low=-1.0, high=1.0)
    u = random_histories(np.random.default_rng(2), 0.0, 1.0, (1, ROWS))[0]
    return model, 0.02 * np.arange(ROWS), u


def _sum() -> tuple[AbstractModel, np.ndarray, np.ndarray]:
    u = random_histories(np.random.default_rng(2), 0.0, 1.0, (1, ROWS))[0]
    slopes = np.array([[0.5, 1.0], [0.2, 0.4]])
    stops = ModulatedStops(0.0, 1.0, np.array([0.1, 0.3]), np.array([0.0, 1.0]), slopes, np.ones(2))
    softening = Softening(0.0, 1.0, np.triu(np.full((3, 3), 0.1)))
    return Sum([stops, softening]), 0.02 * np.arange(ROWS), u


MAKERS: dict[str, Callable[[], tuple[AbstractModel, np.ndarray, np.ndarray]]] = {
    "relays": _relays, "creep": _rated, "conditioned": _conditioned, "plays": _plays,
    "duhem": _duhem, "sum": _sum,
}  # fmt: skip


class Case(NamedTuple):
    """A model, its times, inputs, readings and conditions, and what it is exported from."""

    model: AbstractModel
    t: np.ndarray
    u: np.ndarray
    y: np.ndarray
    c: np.ndarray | None
    program: Program

    @property
    def dt(self) -> np.ndarray:
        return np.diff(self.t, prepend=self.t[0])

    def write(self, target: str, path: Path, real: str | None = None) -> Path:
        """Export it; there is nothing to mind."""
        done = write_to(target, self.program, path, real)
        assert done.notes == ()
        return done.path

    def reference(self, folder: Path, real: str = "double") -> Compiled:
        """The C99 header, compiled."""
        path = self.program.write_c(folder / "reference.h", real).path
        return Compiled(path, flags=("-O2", "-ffp-contract=off"))


@cache
def case(name: str) -> Case:
    """By the name of its maker."""
    model, t, given = MAKERS[name]()
    y = np.asarray(model.simulate(t, given))
    u, c = (given, None) if given.ndim == 1 else np.ascontiguousarray(given.T)
    options: dict[str, Any] = {
        "times": t, "origin": ORIGIN, "title": "A sponge & its <skin>",
        "reading": Quantity("displacement (mm)", "mm"), "estimate": Quantity("force", "N"),
    }  # fmt: skip
    if name == "relays":  # one with a guard and deviations: they take seconds to compile
        options |= {"trained": (float(u.min()), float(u.max())), "start": "unknown"}
        options["error"] = calibrated(invert(model), Record.from_arrays(u, y, time=t))
    readings = y if c is None else np.column_stack([y, c])
    return Case(model, t, u, y, c, Program(model, readings, **options))


def with_gaps(y: np.ndarray) -> np.ndarray:
    """Readings of which a tenth are NaN or infinite."""
    random = np.random.default_rng(5)
    holes = random.random(len(y)) < 0.1
    return np.where(holes, random.choice([np.nan, np.inf, -np.inf], len(y)), y)
