"""What a search from many starts costs beside following every start to its end.

Both run the same compiled Levenberg-Marquardt. The search takes a few steps from every start and follows
the best ones, see `Problem.searched`.
"""

import numpy as np

from hysteresis import Burgers, Record
from identify.parameters._transform import transform_for
from identify.parametric._multistart import Problem
from identify.records._new_record import prepare

from .._measure import Row, interleaved, judged, noted

SAMPLES, STARTS, SPREAD = 1000, 64, 1.5


def start_rows(quick: bool) -> list[Row]:
    """64 starts of a Burgers element, and whether the best of them is as good."""
    t = np.linspace(0, 60, SAMPLES)
    u = np.interp(t, np.linspace(0, 60, 13), [0, 5, 5, 5, 1, 1, 3, 3, 0.5, 4, 4, 2, 0])
    truth, random = Burgers(2.0, 100.0, 1.0, 8.0, 0.3), np.random.default_rng(0)
    y = np.asarray(truth.simulate(t, u))
    record = Record.from_arrays(u, y + random.normal(0, 0.02 * np.ptp(y), SAMPLES), t)
    bounds, prepared = transform_for(truth, record).for_fit, prepare(truth, record)
    about = bounds.to_free(truth)
    points = about + SPREAD * random.normal(size=(STARTS, len(about)))
    problem, weights = Problem(bounds, truth, prepared, record.output), record.mask.astype(float)

    def search() -> float:
        return float(problem.searched(weights, points)[0].objective[0])

    def all_to_their_end() -> float:
        return min(problem.refined(weights, point).objective for point in points)

    calls = {"search": search, "all": all_to_their_end}
    seconds = {k: taken.min() for k, taken in interleaved(calls, 5 if quick else 15).items()}
    what = f"{STARTS} starts of Burgers, {SAMPLES} samples: search over following all to their end"
    same = f"{what.split(':')[0]}: best objective over that of following all"
    return [
        noted(what, seconds["search"] / seconds["all"]),
        judged(same, search() / all_to_their_end(), 1.001),
    ]
