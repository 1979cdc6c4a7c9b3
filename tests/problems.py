"""The models every law is tested on, and the input histories that drive them: one table."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
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
from tests.densities import warped
from tests.thorough import rest_thorough

Tag = Literal["rates", "lagging", "leading", "memoryless", "grid", "flat", "no-inverse"]
Makes = Callable[[np.random.Generator], AbstractModel]
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
    make: Makes
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


def _sponge(threshold: float) -> Makes:
    return lambda rng: LinearSponge(K=rng.uniform(0.5, 2), b=rng.uniform(1, 8), threshold=threshold)


def _burgers(rng: np.random.Generator, leading: bool, hold: Any) -> Burgers:
    E1, E2 = rng.uniform(1, 4, 2)
    eta1, eta2 = rng.uniform(20, 80), rng.uniform(2, 10)
    return Burgers(E1, eta1, E2, eta2, rng.normal(), leading=leading, hold=hold)


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
    rng: np.random.Generator, initial: str = "negative", leading: bool = False, reversible: bool = False,
    sparse: bool = False, share_up: bool = False, dead_band: float = 0.0,
) -> Preisach:  # fmt: skip
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


def _signed(rng: np.random.Generator) -> Preisach:
    """Relays of both signs: no branch need rise."""
    signs = rng.choice([-1.0, 1.0], (CELLS, CELLS))
    return Preisach(GridDensity(LOW, HIGH, weights(rng) * signs, signed=True))


def _play(rng: np.random.Generator, leading=False, rates=False) -> PrandtlIshlinskii:
    r, w = np.cumsum(rng.uniform(0.1, 0.4, 4)), rng.uniform(0.1, 1.0, 4)
    return PrandtlIshlinskii(
        r, w, rng.uniform(0.5, 2.0), rng.normal(), rates=rng.uniform(0, 0.02, 4) if rates else None,
        bends=np.array([-1.5, 0.4, 2.0]), bend_slopes=rng.uniform(-0.3, 0.6, 3), leading=leading,
    )  # fmt: skip


def _with_density(rng: np.random.Generator) -> Preisach:
    """With a reversible part, so that the input can be found behind every output."""
    reversible = rng.uniform(0.1, 0.5, DENSITY_CELLS)
    return Preisach(warped(rng, LOW, HIGH), reversible, rng.normal())


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
    ways = ((float(model.offset), 0.9, 7), (0.9, -0.9, 9), (-0.9, 1.5, 9))
    legs = [np.linspace(*way) for way in ways]
    u, y = [0.0], [float(model.offset)]

    def slowness(x: float, f: np.ndarray) -> float:
        return 1 / np.interp(x, knots, f)

    for leg, slopes in zip(legs, (model.rising, model.falling, model.rising), strict=True):
        values = np.asarray(slopes)
        for a, b in pairwise(leg):
            inner = knots[(knots > min(a, b)) & (knots < max(a, b))]
            places = np.sort([a, b, *inner])
            way = 0.0
            for low, high in pairwise(places):
                way += quad(slowness, low, high, (values,), epsabs=0, epsrel=1e-13)[0]
            u.append(u[-1] + np.sign(b - a) * way)
            y.append(b)
    return np.array(u), np.array(u), np.array(y)


def _problem(
    name: str, make: Makes, *tags: Tag, low: float = LOW, high: float = HIGH, known: Any = None
) -> Problem:
    return Problem(name, make, low, high, frozenset(tags), known)


PROBLEMS: tuple[Problem, ...] = (
    _problem("sponge", _sponge(-np.inf), "memoryless", low=0.0, high=20.0),
    _problem("sponge-threshold", _sponge(1.5), "memoryless", "flat", low=0.0, high=20.0),
    *(
        _problem(name, make, "rates", side, low=-2.0, high=5.0, known=_viscoelastic_known)
        for name, make, side in (
            ("burgers-lagging-linear", partial(_burgers, leading=False, hold="linear"), "lagging"),
            ("burgers-lagging-constant", partial(_burgers, leading=False, hold="constant"), "lagging"),
            ("burgers-leading-linear", partial(_burgers, leading=True, hold="linear"), "leading"),
            ("burgers-leading-constant", partial(_burgers, leading=True, hold="constant"), "leading"),
            ("kelvin-voigt", _kelvin_voigt, "leading"),
            ("maxwell", _maxwell, "leading"),
            ("standard-solid", _solid, "lagging"),
        )
    ),
    *(
        _problem(name, make, "rates", known=compositions.held)
        for name, make in compositions.MAKERS.items()
    ),
    _problem("play-leading-bent", partial(_play, leading=True), "leading", low=-3.0, high=3.0),
    _problem("play-rates-bent", partial(_play, rates=True), "rates", "lagging", low=-3.0, high=3.0),
    _problem("preisach-negative", _preisach, "grid", "lagging"),
    _problem(
        "preisach-positive", partial(_preisach, initial="positive", reversible=True), "grid", "lagging"
    ),
    _problem("preisach-up", partial(_preisach, reversible=True, share_up=True), "lagging"),
    _problem(
        "preisach-dead-band",
        partial(_preisach, reversible=True, dead_band=(HIGH - LOW) / CELLS), "lagging",
    ),
    _problem("foam", _foam, "memoryless", low=0.0, high=8.0, known=_foam_known),
    _problem("duhem", _duhem, known=_duhem_known),
    _problem("curve", _curve, "memoryless"),
    _problem("bouc-wen", _bouc_wen, "leading", low=-3.0, high=3.0),
    _problem("degrading-bouc-wen", compositions.degrading, "leading", low=-3.0, high=3.0),
    _problem("stops-by-position", compositions.place_stops, known=compositions.jumped),
    _problem("plays", compositions.plays, known=compositions.jumped),
    _problem("stops-by-span", compositions.span_stops, known=compositions.jumped),
    _problem("stops-and-powers", _stops_and_powers, "no-inverse", known=_stops_and_powers_known),
    _problem("drift", compositions.drifting, known=compositions.held),
    _problem("warped-grid", _with_density, "grid", "lagging"),
    _problem("preisach-sparse", partial(_preisach, sparse=True), "grid", "lagging", "flat"),
    _problem("preisach-leading", partial(_preisach, leading=True), "grid", "leading"),
    _problem("preisach-signed", _signed, "grid", "no-inverse"),
    _problem("rate-forms", _rate_forms, "no-inverse", known=_rate_forms_known),
    _problem("oscillator", _oscillator, "rates", "no-inverse", known=_oscillator_known),
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
