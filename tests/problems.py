"""The models every law is tested on, and the input histories that drive them: one table."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Literal, get_args

import jax.numpy as jnp
import numpy as np
from hypothesis import strategies as st
from scipy.integrate import quad

from hysteresis import (
    AbstractModel,
    BoucWen,
    BoucWenForce,
    Burgers,
    DuhemForce,
    DuhemOperator,
    FoamCurve,
    GeneralizedKelvinVoigt,
    GeneralizedMaxwell,
    GeneralizedPlays,
    LinearSponge,
    MonotoneCurve,
    Oscillator,
    PrandtlIshlinskii,
    Preisach,
    StandardLinearSolid,
    StopsAndPowers,
    Sum,
    parameters,
)
from hysteresis.preisach import GridDensity
from tests import compositions
from tests.densities import CELLS as DENSITY_CELLS
from tests.densities import Make, warped
from tests.thorough import rest_thorough

Tag = Literal["rates", "lagging", "leading", "memoryless", "grid", "flat", "no-inverse"]
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
      on a grid), `flat` (there are inputs over which some branch does not change), `no-inverse` (some
      branch falls, so `invert` refuses the model).
    - `known`: `(t, u, y)` of a model, from its equations, where no test of the model has a reference.
    """

    name: str
    make: Callable[[np.random.Generator], AbstractModel]
    low: float
    high: float
    tags: frozenset[Tag]
    known: Callable[[AbstractModel], Known] | None = None

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


def play(u: np.ndarray, radius: float) -> np.ndarray:
    """A play of this radius, row by row, from the first input."""
    found, at = np.empty(len(u)), u[0]
    for k, x in enumerate(u):
        found[k] = at = min(max(at, x - radius), x + radius)
    return found


def without(hole: np.ndarray, t: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Times and readings of a record that never had the samples of `hole`.

    The last reading is repeated until the record is as long as before, so that no other program is compiled
    for it: what comes later changes no estimate before it.
    """
    t, y = t[~hole], y[~hole]
    count = int(hole.sum())
    return (
        np.append(t, t[-1] + 1e-3 * np.arange(1, count + 1)),
        np.concatenate([y, np.repeat(y[-1:], count, axis=0)]),
    )


def rms(error: np.ndarray) -> float:
    return float(np.sqrt(np.mean(error**2)))


def weights(rng: np.random.Generator, sparse: bool = False) -> np.ndarray:
    """(n, n) positive masses; with `sparse` four fifths of them, and whole rows and columns, are 0."""
    w = np.tril(rng.uniform(0.1, 1.0, (CELLS, CELLS)))
    if sparse:
        w[rng.random(w.shape) < 0.8] = 0.0
        w[3], w[:, 3] = 0.0, 0.0
    return w


def _sponge(threshold: float) -> Callable[[np.random.Generator], LinearSponge]:
    return lambda rng: LinearSponge(K=rng.uniform(0.5, 2), b=rng.uniform(1, 8), threshold=threshold)


def _burgers(leading: bool, hold: Literal["linear", "constant"]):
    def make(rng: np.random.Generator) -> Burgers:
        E1, E2 = rng.uniform(1, 4, 2)
        eta1, eta2 = rng.uniform(20, 80), rng.uniform(2, 10)
        return Burgers(E1, eta1, E2, eta2, rng.normal(), leading=leading, hold=hold)

    return make


def _kelvin_voigt(rng: np.random.Generator) -> GeneralizedKelvinVoigt:
    E, eta = rng.uniform(1, 4, 3), np.array([0.1, 1.0, 10.0]) * rng.uniform(1, 4, 3)
    E0, eta0, offset = rng.uniform(1, 4), rng.uniform(20, 80), rng.normal()
    return GeneralizedKelvinVoigt(E0, E, eta, eta0, offset, leading=True)


def _maxwell(rng: np.random.Generator) -> GeneralizedMaxwell:
    tau = np.array([0.1, 1.0, 10.0]) * rng.uniform(0.5, 2, 3)
    return GeneralizedMaxwell(rng.uniform(1, 4), rng.uniform(1, 4, 3), tau, rng.normal())


def _solid(rng: np.random.Generator) -> StandardLinearSolid:
    return StandardLinearSolid(*rng.uniform(1, 4, 2), rng.uniform(2, 10), rng.normal())


def _viscoelastic_known(model: AbstractModel) -> Known:
    """A unit step of what drives the chain: creep, or relaxation."""
    assert hasattr(model, "creeps")
    t = np.concatenate([[0.0], np.cumsum(np.geomspace(1e-3, 2.0, 60))])
    answer = np.asarray(model.creep_compliance(t) if model.creeps else model.relaxation_modulus(t))
    u, y = (answer, np.ones_like(t)) if model.against_chain else (np.ones_like(t), answer)
    return t, u, y + float(model.offset)


def _preisach(
    initial: str | tuple[float, ...],
    leading: bool = False,
    reversible: bool = False,
    sparse: bool = False,
    share_up: bool = False,
    dead_band: float = 0.0,
):
    def make(rng: np.random.Generator) -> Preisach:
        density = GridDensity(LOW, HIGH, weights(rng, sparse))
        increments = rng.uniform(0.1, 0.5, CELLS) if reversible or leading else None
        if leading and increments is not None:
            # Steeper than the relays can fall: least_slope is that of the relays, per unit of input.
            flat = Preisach(density, jnp.zeros(CELLS), leading=True).least_slope()
            increments -= np.asarray(flat) * ((HIGH - LOW) / CELLS)
        up = np.asarray(density.weights) * rng.random((CELLS, CELLS)) if share_up else None
        return Preisach(
            density, increments, rng.normal(), up,
            leading=leading, initial=initial, dead_band=dead_band,
        )  # fmt: skip

    return make


def _signed(rng: np.random.Generator) -> Preisach:
    """Relays of both signs: no branch need rise."""
    signs = rng.choice([-1.0, 1.0], (CELLS, CELLS))
    return Preisach(GridDensity(LOW, HIGH, weights(rng) * signs, signed=True))


def _play(leading: bool = False, bent: bool = False, rates: bool = False):
    def make(rng: np.random.Generator) -> PrandtlIshlinskii:
        r, w = np.cumsum(rng.uniform(0.1, 0.4, 4)), rng.uniform(0.1, 1.0, 4)
        return PrandtlIshlinskii(
            r, w, rng.uniform(0.5, 2.0), rng.normal(), rates=rng.uniform(0, 0.02, 4) if rates else None,
            bends=np.array([-1.5, 0.4, 2.0]) if bent else None,
            bend_slopes=rng.uniform(-0.3, 0.6, 3) if bent else None, leading=leading,
        )  # fmt: skip

    return make


def _with_density(make_density: Make) -> Callable[[np.random.Generator], Preisach]:
    """With a reversible part, so that the input can be found behind every output."""

    def make(rng: np.random.Generator) -> Preisach:
        reversible = rng.uniform(0.1, 0.5, DENSITY_CELLS)
        return Preisach(make_density(rng, LOW, HIGH), reversible, rng.normal())

    return make


def _foam(rng: np.random.Generator) -> FoamCurve:
    parts, lengths = rng.uniform(0.5, 2.0, (2, 4))
    return FoamCurve(
        parts[0], parts[1] / 3, parts[2], lengths[0], lengths[1], lengths[2],
        rounding=lengths[3], densification=parts[3], offset=rng.normal(),
    )  # fmt: skip


def _foam_known(model: AbstractModel) -> Known:
    """The slope, integrated by quadrature."""
    linear, toe, plateau, *lengths, w, growth, offset = (float(p) for _, _, p in parameters(model))
    u1, u2, u3 = np.cumsum(lengths)

    def slope(u: float) -> float:
        first, second = ((1 + (u - at) / np.hypot(u - at, w)) / 2 for at in (u1, u2))
        ramp = (u - u3 + np.hypot(u - u3, w)) / 2
        return toe * (1 - first) + first - second + plateau * second + growth * ramp

    u = np.linspace(-2.0, 10.0, 25)
    y = np.array([quad(slope, 0, end, epsabs=0, epsrel=1e-13)[0] for end in u])
    return u, u, offset + linear * y


def _curve(rng: np.random.Generator) -> MonotoneCurve:
    nodes = np.append(0.0, np.cumsum(rng.uniform(0.1, 1.0, 5)))
    nodes = LOW + (HIGH - LOW) * nodes / nodes[-1]
    return MonotoneCurve(nodes, rng.uniform(0.1, 1.0, 5), rng.normal())


def _bouc_wen(rng: np.random.Generator) -> BoucWen:
    return BoucWen(rng.uniform(0.5, 2), rng.uniform(0.05, 0.5), rng.uniform(0.3, 1), 1.0,
                   rng.uniform(-0.5, 0.9), rng.normal())  # fmt: skip


def _rate_forms(rng: np.random.Generator) -> Sum:
    """Bouc-Wen of mixed sign, a Duhem operator, and plays whose curves fall and rise."""
    return Sum(
        BoucWenForce(rng.uniform(0.5, 1), rng.uniform(0.2, 0.4), -rng.uniform(0.1, 0.2)),
        DuhemForce(rng.uniform(0.2, 1, 5), rng.uniform(0.2, 1, 5), 2.0),
        GeneralizedPlays([0.0, 0.4], [1.0, 1.5], rng.normal(size=7) - 4 * np.arange(7), (3, 4)),
    )


def _rate_forms_known(model: AbstractModel) -> Known:
    """Up so little that f is straight and one play alone moves: exponentials."""
    force, duhem, plays = model.parts
    u = np.linspace(0.0, 0.01, 21)
    loss = float(force.beta_gamma + force.beta_delta)
    f = np.asarray(duhem.rising)
    steep = f[3] - f[2]  # by one: the knots are one apart
    g = np.asarray(plays.values)
    lag = 0.5 * (g[4] + g[5])  # the play that rests is in the middle of the second of three cells
    z = -float(force.alpha) * np.expm1(-loss * u) / loss + f[2] * np.expm1(steep * u) / steep
    return u, u, z + g[1] + (g[2] - g[1]) * u + lag


def _oscillator(rng: np.random.Generator) -> Oscillator:
    """Slower than the clocks of the histories, whose steps are up to ten long."""
    spring = Sum(
        BoucWenForce(rng.uniform(0.5, 1), rng.uniform(0.02, 0.04), -rng.uniform(0.01, 0.02)),
        GeneralizedPlays([0.3], [2.0], [rng.uniform(-1, -0.5), rng.uniform(0.5, 1)], (2,)),
    )
    return Oscillator(rng.uniform(300, 500), rng.uniform(5, 10), rng.uniform(1, 2), spring, 2)


def _oscillator_known(model: AbstractModel) -> Known:
    """One step of Newmark's method from rest, by bisection: the play rests."""
    force, plays = model.hysteresis.parts
    m, c, k = (float(x) for x in (model.mass, model.damping, model.stiffness))
    alpha, gamma, delta = (float(x) for x in (force.alpha, force.beta_gamma, force.beta_delta))
    t, u, h = np.array([0.0, 0.2]), np.array([0.0, 1.0]), 0.1
    rest = float(np.asarray(plays.values).mean())
    y = v = z = y1 = v1 = a1 = z1 = 0.0
    a = -rest / m
    for push in (0.5, 1.0):
        low, high = -1.0, 1.0
        for _ in range(200):  # bisection of the acceleration
            a1 = 0.5 * (low + high)
            y1, v1 = y + h * v + h * h / 4 * (a + a1), v + h / 2 * (a + a1)
            side = 1.0 if v1 >= 0 else -1.0
            f0 = alpha - (np.sign(z) * (-1.0 if v < 0 else 1.0) * gamma + delta) * abs(z)
            z1 = z
            for _ in range(60):
                f1 = alpha - (np.sign(z1) * side * gamma + delta) * abs(z1)
                z1 = z + h / 2 * (v * f0 + v1 * f1)
            off = m * a1 + c * v1 + k * y1 + z1 + rest - push
            low, high = (a1, high) if off < 0 else (low, a1)
        y, v, a, z = y1, v1, a1, z1
    return t, u, np.array([0.0, y])


def _duhem(rng: np.random.Generator) -> DuhemOperator:
    rising, falling = rng.uniform(0.3, 2.0, (2, 4))
    return DuhemOperator(rising, falling, -0.7, 1.1, rng.uniform(-0.3, 0.3))


def _stops_and_powers(rng: np.random.Generator) -> StopsAndPowers:
    return StopsAndPowers([0.3, 1.1], rng.uniform(-1.0, 1.0, 2), rng.uniform(-1.0, 1.0, 3))


def _stops_and_powers_known(model: AbstractModel) -> Known:
    """Both stops slide, and after the reversal the narrow one does."""
    u, strains = np.array([0.0, 2.0, 1.5, -0.5]), ((0, 0.3, -0.2, -0.3), (0, 1.1, 0.6, -1.1))
    powers = np.stack([u**2, u**3, u * np.abs(u)])
    return u, u, np.asarray(model.weights) @ np.array(strains) + np.asarray(model.powers) @ powers


def _duhem_known(model: AbstractModel) -> Known:
    """Up, down below the first knot, and up beyond the last one: the way is an integral over the output."""
    knots = np.linspace(float(model.low), float(model.high), 4)
    legs = (
        np.linspace(float(model.offset), 0.9, 7),
        np.linspace(0.9, -0.9, 9),
        np.linspace(-0.9, 1.5, 9),
    )
    u, y = [0.0], [float(model.offset)]
    for leg, slopes in zip(legs, (model.rising, model.falling, model.rising), strict=True):
        values = np.asarray(slopes)
        for a, b in pairwise(leg):
            inner = knots[(knots > min(a, b)) & (knots < max(a, b))]
            places = np.sort([a, b, *inner])
            way = sum(
                quad(
                    lambda x, f: 1 / np.interp(x, knots, f), *p, (values,), epsabs=0, epsrel=1e-13
                )[0]
                for p in pairwise(places)
                if p[1] > p[0]
            )
            u.append(u[-1] + np.sign(b - a) * way)
            y.append(b)
    return np.array(u), np.array(u), np.array(y)


def _density_problem(name: str, make_density: Make, *tags: Tag) -> Problem:
    make = _with_density(make_density)
    return Problem(name, make, LOW, HIGH, frozenset({"lagging", *tags}))


def _burgers_problem(
    orientation: Literal["lagging", "leading"], hold: Literal["linear", "constant"]
) -> Problem:
    make = _burgers(orientation == "leading", hold)
    tags: frozenset[Tag] = frozenset({"rates", orientation})
    return Problem(f"burgers-{orientation}-{hold}", make, -2.0, 5.0, tags, _viscoelastic_known)


def _preisach_problem(
    name: str, make: Callable[[np.random.Generator], Preisach], *tags: Tag
) -> Problem:
    grid: frozenset[Tag] = frozenset({"grid"})
    return Problem(f"preisach-{name}", make, LOW, HIGH, grid.union(tags))


PROBLEMS: tuple[Problem, ...] = (
    Problem(
        "sponge", _sponge(-np.inf), 0.0, 20.0, frozenset[Tag]({"memoryless"})
    ),
    Problem(
        "sponge-threshold", _sponge(1.5), 0.0, 20.0, frozenset[Tag]({"memoryless", "flat"}),
    ),
    _burgers_problem("lagging", "linear"),
    _burgers_problem("lagging", "constant"),
    _burgers_problem("leading", "linear"),
    _burgers_problem("leading", "constant"),
    Problem(
        "kelvin-voigt", _kelvin_voigt, -2.0, 5.0, frozenset[Tag]({"rates", "leading"}),
        _viscoelastic_known,
    ),
    Problem(
        "maxwell", _maxwell, -2.0, 5.0, frozenset[Tag]({"rates", "leading"}), _viscoelastic_known
    ),
    Problem(
        "standard-solid", _solid, -2.0, 5.0, frozenset[Tag]({"rates", "lagging"}),
        _viscoelastic_known,
    ),
    *(
        Problem(name, make, LOW, HIGH, frozenset[Tag]({"rates"}), compositions.held)
        for name, make in compositions.MAKERS.items()
    ),
    Problem(
        "play-leading-bent", _play(True, True), -3.0, 3.0, frozenset[Tag]({"leading"})
    ),
    Problem(
        "play-rates-bent", _play(False, True, True), -3.0, 3.0,
        frozenset[Tag]({"rates", "lagging"}),
    ),
    _preisach_problem("negative", _preisach("negative"), "lagging"),
    _preisach_problem("positive", _preisach("positive", reversible=True), "lagging"),
    Problem(
        "preisach-up", _preisach("negative", reversible=True, share_up=True), LOW, HIGH,
        frozenset[Tag]({"lagging"}),
    ),
    Problem(
        "preisach-dead-band",
        _preisach("negative", reversible=True, dead_band=(HIGH - LOW) / CELLS), LOW, HIGH,
        frozenset[Tag]({"lagging"}),
    ),
    Problem("foam", _foam, 0.0, 8.0, frozenset[Tag]({"memoryless"}), _foam_known),
    Problem("duhem", _duhem, LOW, HIGH, frozenset[Tag](), _duhem_known),
    Problem("curve", _curve, LOW, HIGH, frozenset[Tag]({"memoryless"})),
    Problem("bouc-wen", _bouc_wen, -3.0, 3.0, frozenset[Tag]({"leading"})),
    Problem(
        "degrading-bouc-wen", compositions.degrading, -3.0, 3.0, frozenset[Tag]({"leading"}),
    ),
    Problem(
        "stops-by-position", compositions.place_stops, LOW, HIGH, frozenset[Tag](),
        compositions.jumped,
    ),
    Problem(
        "plays", compositions.plays, LOW, HIGH, frozenset[Tag](), compositions.jumped,
    ),
    Problem(
        "stops-by-span", compositions.span_stops, LOW, HIGH, frozenset[Tag](), compositions.jumped
    ),
    Problem(
        "stops-and-powers", _stops_and_powers, LOW, HIGH, frozenset[Tag]({"no-inverse"}),
        _stops_and_powers_known,
    ),
    Problem("drift", compositions.drifting, LOW, HIGH, frozenset[Tag](), compositions.held),
    _density_problem("warped-grid", warped, "grid"),
    _preisach_problem("sparse", _preisach("negative", sparse=True), "lagging", "flat"),
    _preisach_problem("leading", _preisach("negative", leading=True), "leading"),
    _preisach_problem("signed", _signed, "no-inverse"),
    Problem(
        "rate-forms", _rate_forms, LOW, HIGH, frozenset[Tag]({"no-inverse"}), _rate_forms_known
    ),
    Problem(
        "oscillator", _oscillator, LOW, HIGH, frozenset[Tag]({"rates", "no-inverse"}), _oscillator_known
    ),
)  # fmt: skip

VARIANTS = frozenset({
    "sponge", "burgers-lagging-constant", "burgers-leading-linear", "kelvin-voigt", "maxwell",
    "standard-solid", "scaled", "curve", "preisach-negative", "preisach-positive", "preisach-sparse",
    "preisach-leading", "preisach-signed", "warped-grid", "play-leading-bent", "stops-by-position",
    "stops-by-span", "rate-forms",
})  # fmt: skip
"""Problems whose code another one runs too, with other numbers or signs, or in another order."""


def variants_thorough(problems: Iterable[Problem]) -> list[Any]:
    """Problems for `parametrize`: `make test` leaves out the variants."""
    return rest_thorough(problems, lambda problem: problem.name not in VARIANTS)


KINDS = frozenset({
    "sponge-threshold", "preisach-up", "burgers-leading-constant", "play-rates-bent", "series",
    "bouc-wen",
})  # fmt: skip
"""One problem of each way to keep a state."""


def kinds_often(problems: Iterable[Problem]) -> list[Any]:
    """Problems for `parametrize` of what is done around a model and not by it: one of each kind often."""
    return rest_thorough(problems, lambda problem: problem.name in KINDS)


INVERTIBLE = tuple(problem for problem in PROBLEMS if "no-inverse" not in problem.tags)

TAGS: tuple[Tag, ...] = get_args(Tag)


def tagged(*tags: Tag) -> list[Problem]:
    """The problems that carry all of these tags."""
    return [p for p in PROBLEMS if p.tags.issuperset(tags)]
