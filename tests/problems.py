"""The models every law is tested on, and the input histories that drive them: one table."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, get_args

import jax.numpy as jnp
import numpy as np
from hypothesis import strategies as st

from hysteresis import AbstractModel, Burgers, LinearSponge, Preisach
from hysteresis.preisach import GridDensity

Tag = Literal["rates", "lagging", "leading", "memoryless", "grid", "flat"]
Known = tuple[np.ndarray, np.ndarray, np.ndarray]
SAMPLES = 40
"""Length of the histories: one length, so that a law compiles once per problem."""

LOW, HIGH = -1.0, 2.0
CELLS = 7


@dataclass(frozen=True)
class Problem:
    """A model whose parameters are drawn, and where to drive it.

    - `make`: parameters from a random generator; whatever is static is the same every time.
    - `low`, `high`: inputs of the histories.
    - `tags`: `rates` (time matters), `lagging` or `leading` (loops), `memoryless`, `grid` (Preisach
      on a grid), `flat` (there are inputs over which some branch does not change).
    - `known`: `(t, u, y)` of a model, from its equations.
    """

    name: str
    make: Callable[[np.random.Generator], AbstractModel]
    low: float
    high: float
    tags: frozenset[Tag]
    known: Callable[[AbstractModel], Known]

    def model(self, seed: int = 0) -> AbstractModel:
        """The model with the parameters of a seed."""
        return self.make(np.random.default_rng(seed))


def histories(low: float, high: float, samples: int = SAMPLES) -> st.SearchStrategy[np.ndarray]:
    """Inputs (samples,): walks between turning points, with ties, plateaus and single samples."""
    lattice = st.integers(0, 12).map(lambda k: low + (high - low) * k / 12)
    # XLA's threads take subnormal numbers for 0, NumPy's do not.
    value = lattice | st.floats(low, high, allow_subnormal=False)
    counts = st.sampled_from([1, 2, max(1, samples // 8), max(1, samples // 3), samples])
    turns = counts.flatmap(lambda n: st.lists(value, min_size=n, max_size=n))
    return turns.map(lambda v: np.interp(np.linspace(0, len(v) - 1, samples), range(len(v)), v))


def clock(seed: int, samples: int = SAMPLES) -> np.ndarray:
    """Times (samples,) with steps spread over four decades."""
    return np.cumsum(10.0 ** np.random.default_rng(seed).uniform(-3, 1, samples))


def random_histories(rng: np.random.Generator, low: float, high: float, shape: tuple[int, int]):
    """Inputs of `shape`: each row a walk between turning points drawn anew, half of them noise."""
    rows, samples = shape
    turns = rng.uniform(low, high, shape)
    walks = [
        np.interp(np.linspace(0, samples // stride - 1, samples), np.arange(samples), row)
        for row, stride in zip(turns, rng.choice([1, 1, 4, 10], rows), strict=True)
    ]
    return np.stack(walks)


def weights(rng: np.random.Generator, sparse: bool = False) -> np.ndarray:
    """(n, n) positive masses; with `sparse` four fifths of them, and whole rows and columns, are 0."""
    w = np.tril(rng.uniform(0.1, 1.0, (CELLS, CELLS)))
    if sparse:
        w[rng.random(w.shape) < 0.8] = 0.0
        w[3], w[:, 3] = 0.0, 0.0
    return w


def _sponge(threshold: float) -> Callable[[np.random.Generator], LinearSponge]:
    return lambda rng: LinearSponge(K=rng.uniform(0.5, 2), b=rng.uniform(1, 8), threshold=threshold)


def _sponge_known(model: AbstractModel) -> Known:
    """A line above the threshold."""
    assert isinstance(model, LinearSponge)
    u = np.linspace(-2.0, 20.0, 45)
    return u, u, np.where(u >= float(model.threshold), float(model.K) * u + float(model.b), 0.0)


def _burgers(leading: bool, hold: Literal["linear", "constant"]):
    def make(rng: np.random.Generator) -> Burgers:
        E1, E2 = rng.uniform(1, 4, 2)
        eta1, eta2 = rng.uniform(20, 80), rng.uniform(2, 10)
        return Burgers(E1, eta1, E2, eta2, rng.normal(), leading=leading, hold=hold)

    return make


def _burgers_known(model: AbstractModel) -> Known:
    """A unit step: creep, or relaxation where the input between samples is what the law assumes."""
    assert isinstance(model, Burgers)
    t = np.concatenate([[0.0], np.cumsum(np.geomspace(1e-3, 2.0, 60))])
    if not model.leading:
        return t, np.ones_like(t), np.asarray(model.creep_compliance(t) + model.offset)
    # The leading element follows the load it was solved for: the inverse of the creep curve is 1.
    return t, np.asarray(model.creep_compliance(t)), np.ones_like(t) + float(model.offset)


def _preisach(
    initial: Literal["negative", "positive", "demagnetised"],
    leading: bool = False,
    reversible: bool = False,
    sparse: bool = False,
):
    def make(rng: np.random.Generator) -> Preisach:
        density = GridDensity(LOW, HIGH, weights(rng, sparse))
        increments = rng.uniform(0.1, 0.5, CELLS) if reversible or leading else None
        if leading and increments is not None:
            # Steeper than the relays can fall: least_slope is that of the relays, per unit of input.
            flat = Preisach(density, jnp.zeros(CELLS), leading=True).least_slope()
            increments -= np.asarray(flat) * ((HIGH - LOW) / CELLS)
        return Preisach(density, increments, rng.normal(), leading=leading, initial=initial)

    return make


def _preisach_known(model: AbstractModel) -> Known:
    """Node by node from negative saturation up, and down again: whole rows and columns switch."""
    assert isinstance(model, Preisach)
    assert isinstance(model.density, GridDensity)
    w = np.tril(np.asarray(model.density.weights))
    nodes = np.linspace(LOW, HIGH, CELLS + 1)
    up = np.append(0.0, np.cumsum(w.sum(1)))
    down = np.append(0.0, np.cumsum(w.sum(0)))
    R = np.zeros(CELLS + 1)
    if model.reversible is not None:
        R[1:] = np.cumsum(np.asarray(model.reversible))
    relays = np.concatenate([2 * up, 2 * down[::-1]]) - w.sum()
    u = np.concatenate([nodes, nodes[::-1]])
    y = model.orientation * relays + np.concatenate([R, R[::-1]]) + float(model.offset)
    return np.zeros_like(u), u, y


def _burgers_problem(
    orientation: Literal["lagging", "leading"], hold: Literal["linear", "constant"]
) -> Problem:
    make = _burgers(orientation == "leading", hold)
    tags: frozenset[Tag] = frozenset({"rates", orientation})
    return Problem(f"burgers-{orientation}-{hold}", make, -2.0, 5.0, tags, _burgers_known)


def _preisach_problem(
    name: str, make: Callable[[np.random.Generator], Preisach], *tags: Tag
) -> Problem:
    grid: frozenset[Tag] = frozenset({"grid"})
    return Problem(f"preisach-{name}", make, LOW, HIGH, grid.union(tags), _preisach_known)


PROBLEMS: tuple[Problem, ...] = (
    Problem(
        "sponge", _sponge(-np.inf), 0.0, 20.0, frozenset[Tag]({"memoryless"}), _sponge_known
    ),
    Problem(
        "sponge-threshold", _sponge(1.5), 0.0, 20.0, frozenset[Tag]({"memoryless", "flat"}),
        _sponge_known,
    ),
    _burgers_problem("lagging", "linear"),
    _burgers_problem("lagging", "constant"),
    _burgers_problem("leading", "linear"),
    _burgers_problem("leading", "constant"),
    _preisach_problem("negative", _preisach("negative"), "lagging"),
    _preisach_problem("positive", _preisach("positive", reversible=True), "lagging"),
    _preisach_problem("demagnetised", _preisach("demagnetised", reversible=True), "lagging"),
    _preisach_problem("sparse", _preisach("negative", sparse=True), "lagging", "flat"),
    _preisach_problem("leading", _preisach("negative", leading=True), "leading"),
    _preisach_problem("leading-positive", _preisach("positive", leading=True), "leading"),
    _preisach_problem("leading-demagnetised", _preisach("demagnetised", leading=True), "leading"),
)  # fmt: skip

TAGS: tuple[Tag, ...] = get_args(Tag)


def tagged(*tags: Tag) -> list[Problem]:
    """The problems that carry all of these tags."""
    return [p for p in PROBLEMS if p.tags.issuperset(tags)]
