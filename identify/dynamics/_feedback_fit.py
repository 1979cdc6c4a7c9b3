"""From periodic tests to a `Feedback` model: modes first, then channels where they explain most.

1. Modes of the middle level by vector fitting, their number and the delay by a test that is held out.
2. Which law of which drive explains what the modes leave (`_screening.py`).
3. Groups of channels in that order, by Gauss-Newton in three stages: reactions, how they enter, what drives
   them. A group stays where the tests that are held out gain from it; then all tests, at last the held-out
   ones.
4. The same groups from tests of all levels but the middle one, which those then predict.

Cost: a pass of every test for each of some forty steps, and of the fourth stage as many.
"""

import time
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from hysteresis import Feedback, InputError, StopsAndPowers

from .._levels import LITTLE
from ._feedback_search import Spectra, gauss_newton
from ._feedback_unknowns import Unknowns
from ._modes import WORTH, chosen_modes, in_own_units
from ._periodic_tests import (
    PeriodicTest,
    excited_lines,
    input_sizes,
    linear_response,
    spectra_of,
    steady_ones,
)
from ._screening import GROUPS, Screened, drives_of, screening, to_unit

THRESHOLDS = np.geomspace(0.004, 2.5, 10)
"""Of the stops of a channel, in root mean squares of its drive at the middle level."""


class FeedbackFit(NamedTuple):
    """A fitted model, and how it was found.

    - `model`: in the tests' units. `linear`: its start without channels, of the middle level.
    - `levels`: root mean square of the inputs at each level. `errors`, `linear_errors`: of each level, on
      the test that was held out of the fit then, but has chosen modes and groups: rms of the error of the
      mean period over that of the output, mean over outputs; NaN of a level with one test.
    - `unseen`: the same error on all tests of the middle level of the same groups, fitted to the other
      levels' tests alone; NaN where no time was left, or there are fewer than two other levels.
    - `held_out`: which tests those were. `left_out`: tests whose periods differ three times as much as
      those of others.
    - `screening`: candidate laws and drives. `groups`: those of the model's channels, in order.
    - `left`: the most that a steady state's last step changed its drives by.
    """

    model: Feedback
    linear: Feedback
    levels: tuple[float, ...]
    errors: tuple[float, ...]
    linear_errors: tuple[float, ...]
    unseen: float
    held_out: tuple[int, ...]
    left_out: tuple[int, ...]
    screening: tuple[Screened, ...]
    groups: tuple[str, ...]
    left: float
    seconds: float


# Many small factorisations: threads that wait for each other take ten times as long on a busy machine.
@threadpool_limits.wrap(limits=1, user_api="blas")
def fit_feedback(
    tests: Sequence[PeriodicTest],
    *,
    groups: int = 4,
    seconds: float = 900.0,
    say: Callable[[str], None] = lambda _: None,
) -> FeedbackFit:
    """A linear system with hysteretic channels, from periodic tests of several realisations and levels.

    - `groups`: most groups of channels; 0 fits modes alone. `seconds`: of processor time, after which no
      channels are added and no further step is taken.
    - `say`: takes a line on each stage.

    The last test of each level of two or more is held out. It chooses number of modes, delay and groups; at
    the end it joins the fit, after the errors were taken.

    Raises `InputError` `too-few-runs` where no level has two steady tests, `nothing-fits` where no mode is
    found, `length-mismatch`, `not-finite`, `constant-input` or `constant-output` for unusable tests.

    **Example:**

        >>> truth = hysteresis.Feedback([-0.05 + 1.5j], [[-0.3j]], [[1.0]], [[0.0]])
        >>> rng, tests = np.random.default_rng(0), []
        >>> for _ in range(2):
        ...     lines = np.arange(1, 60)
        ...     phases = 2 * np.pi * rng.random((len(lines), 1))
        ...     u = np.cos(2 * np.pi * np.outer(np.arange(256) / 256, lines) + phases.T).sum(1)[:, None]
        ...     tests.append(identify.periodic_test(u, truth.steady(u, 0.2), 0.2, 256))
        >>> fit = identify.fit_feedback(tests, groups=0)
        >>> fit.model.poles.round(3).tolist()
        [(-0.05+1.5j)]
    """
    begin = time.process_time()
    raw, noise = spectra_of(tests)
    steady = steady_ones(raw, noise)
    kept = np.flatnonzero(steady)
    rms = np.sqrt(np.nan_to_num(noise[:, 1:] ** 2).mean(1))
    in_units, data = in_own_units(raw.weighed(rms).part(steady))
    # The last test of each level of two or more.
    level = data.level
    out = np.array([k in level[:i] and k not in level[i + 1 :] for i, k in enumerate(level)])
    if not out.any():
        raise InputError(
            "too-few-runs",
            "no level has two tests in steady state, so nothing can be held out.",
            fix="measure two realisations of the excitation at a level.",
        )
    train, test = data.part(~out), data.part(out)
    search = _Search(train, test, begin, seconds, say)
    linear = search.modes()
    model = linear
    shares, by_group = screening(model, search.few)
    names: list[str] = []
    open_, least = {*GROUPS}, search.test.error(model)
    while open_ and len(names) < groups and not search.late():
        name = max(open_, key=lambda one: by_group[one])
        open_.remove(name)
        found = search.with_group(model, name)
        if (error := search.test.error(found)) < WORTH * least:
            model, least, names = found, error, [*names, name]
            # What did not gain before may gain beside it.
            open_ = {*GROUPS} - {*names}
            by_group = screening(model, search.few)[1]
    if names:
        model = search.polished(model)
    errors, before = test.errors(model), test.errors(linear)
    unseen = _unseen(data, out, names, search)
    found = gauss_newton(
        model, data.finer(search.fine), Unknowns(), steps=3 if names else 0, damping=5e-3, thin=4,
        until=search.late,
    )  # fmt: skip
    squares, levels = input_sizes(raw.U[steady], raw.lines) ** 2, np.unique(data.level).tolist()
    return FeedbackFit(
        in_units(found.model), in_units(linear),
        tuple(float(np.sqrt(squares[data.level == k].mean())) for k in levels),
        tuple(errors.get(k, np.nan) for k in levels), tuple(before.get(k, np.nan) for k in levels),
        unseen, tuple(kept[out].tolist()),
        tuple(np.flatnonzero(~steady).tolist()), shares, tuple(names),
        max(s.left for s in found.states), time.process_time() - begin,
    )  # fmt: skip


def _unseen(data: Spectra, out: np.ndarray, names: list[str], search: "_Search") -> float:
    """The error at the middle level of a fit of these groups to the others."""
    levels = np.unique(data.level)
    own = data.level == levels[len(levels) // 2]
    # It takes as long as the fit took.
    if len(levels) < 3 or not (out & ~own).any() or search.spent() > search.seconds / 2:
        return float("nan")
    others = _Search(
        data.part(~own & ~out), data.part(~own & out), search.begin, search.seconds, lambda _: None
    )
    model = others.modes()
    for name in names:
        model = others.with_group(model, name)
    model = others.polished(model) if names else model
    error = float(np.mean([*data.part(own).errors(model).values()]))
    search.say(f"{search.spent():5.0f} s  a level left out: error {100 * error:.2f} %")
    return float("nan") if others.late() else error


class _Search:
    """The stages of a fit, on tests it sees and tests that are held out."""

    fine = 4

    def __init__(self, train: Spectra, test: Spectra, begin: float, seconds: float, say: Any):
        self.train, self.test, self.begin, self.seconds, self.say = train, test, begin, seconds, say
        judged, level = np.unique(test.level), train.level
        self.middle = judged[len(judged) // 2]
        self.few = train.part([(level[:i] == k).sum() < 2 for i, k in enumerate(level)])

    def spent(self) -> float:
        return time.process_time() - self.begin

    def late(self) -> bool:
        return self.spent() > self.seconds

    def told(self, what: str, model: Feedback) -> Feedback:
        each = ", ".join(f"{100 * e:.2f}" for e in self.test.errors(model).values())
        self.say(f"{self.spent():5.0f} s  {what}: held-out error {each} %")
        return model

    def modes(self) -> Feedback:
        """Modes of the middle level, by the held-out test there."""
        own, rest = (data.part(data.level == self.middle) for data in (self.train, self.test))
        at = excited_lines(own.U)
        G, _, _ = linear_response(own.U, own.Y, at, 0)
        told = np.ones((len(at), 1)), G.reshape(len(at), -1)
        model = chosen_modes(own, at, told, rest.error)
        return self.told(f"{len(model.poles)} modes", model)

    def with_group(self, model: Feedback, name: str) -> Feedback:
        """With one more group of channels, fitted in three stages."""
        middle = self.train.part(self.train.level == self.middle)
        model = with_channels(model, *to_unit(model, *drives_of(model, name), middle))
        stages = {Unknowns(False, False): 4, Unknowns(True, False): 4, Unknowns(): 8}
        for what, steps in stages.items():
            model = gauss_newton(
                model, self.few, what, steps=steps, damping=1e-2, thin=2, gain=3e-3, until=self.late
            ).model
        return self.told(f"channels of {name}", model)

    def polished(self, model: Feedback) -> Feedback:
        """By all tests, at last in finer steps."""
        for finer, steps in ((2, 20), (self.fine, 3)):
            model = gauss_newton(
                model, self.train.finer(finer), Unknowns(), steps=steps, damping=5e-3, thin=4, gain=1e-3,
                until=self.late,
            ).model  # fmt: skip
        return self.told("all tests", model)


def with_channels(model: Feedback, shapes: Any, direct: Any) -> Feedback:
    """One more channel for each drive, entering where an input does."""
    n, nu, ny = len(shapes), model.inputs, model.outputs
    law = StopsAndPowers(THRESHOLDS, np.full(len(THRESHOLDS), -LITTLE), [1e-4, 0.0, 0.0])
    wide = np.zeros(np.array(model.direct.shape) + n)
    o, i = model.direct.shape
    wide[:o, :i] = model.direct
    wide[o:, :nu], wide[:ny, i:] = direct, model.direct[:ny, :nu][:, np.arange(n) % nu]
    return Feedback(
        model.poles, np.concatenate([model.entries, model.entries[:, np.arange(n) % nu]], 1),
        np.concatenate([model.shapes, shapes]), wide, model.delay, (*model.channels, *[law] * n),
        np.concatenate([model.levels, np.zeros(n)]), model.memory,
    )  # fmt: skip
