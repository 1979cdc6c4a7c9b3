"""Coverage of 90 % bands on held-out cycles of measured sensors.

python -m benchmarks._compensation.bands [--quick] [--json] [--only TEXT]

Each specimen's model is fitted twice: to all of its training part, and without a piece of it, from whose
estimates `calibrated` learns the model's error. That goes with the compensators of the whole fit's draws.
"""

import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np

from compensate import AbstractCompensator, calibrated, estimate, invert
from hysid.intake._selection import Selection
from hysteresis import Record
from identify import FitResult, fit, sample

from .. import _measured_data as data
from .._measure import Row, judged, noted, options, report
from ..accuracy import EFLESH_TEST, EGAIN, EGAIN_SPLIT, FOAM, data_folder

LOW, HIGH = 85.0, 95.0
DRAWS = 16

Cut = Callable[[Record], tuple[Record, Record]]


def last_cycle(record: Record) -> tuple[Record, Record]:
    """All but the last cycle that counts, and that."""
    return record.split_rows(record.cycle >= record.cycle[record.mask].max())


def before_settling(record: Record) -> tuple[Record, Record]:
    """The later half of the cycles, and the earlier: so is another run, which starts after a rest."""
    return record.split_rows(record.cycle <= record.cycle[record.mask].max() // 2)


def every_fourth(record: Record) -> tuple[Record, Record]:
    """Three sequences of four, and the fourth."""
    others = [label for k, label in enumerate(record.labels) if k % 4 != 2]
    return record.take_sequences(others), record.take_sequences(record.labels[2::4])


class Sensor(NamedTuple):
    """What is estimated from what; `cut` takes a piece of the training part off.

    - `ahead`: how many times further from the fit the held-out cycles are than that piece is.
    """

    what: str
    file: str | Callable[[Path, Path], Path]
    selection: Selection
    cut: Cut
    ahead: float = 1.0
    model: str = "auto"


SENSORS = (
    Sensor(
        "foam, force -> compression", FOAM,
        Selection("compression_mm", "force_N", "time_s", each="sample", test_cycles=3),
        last_cycle, ahead=2.0,  # cycles 4 to 6, with 1 to 3 fitted
    ),
    Sensor(
        "eGaIn, voltage -> force", EGAIN,
        Selection("force_pos", "voltage", **EGAIN_SPLIT, test_where=("split=test",)), every_fourth,
    ),
    Sensor(
        "eFlesh, main channel -> load", data.eflesh_loads,
        Selection("load", "main", "time (s)", group=("run",), test_where=EFLESH_TEST),
        before_settling, model="Preisach",
    ),
)  # fmt: skip


def band_rows(quick: bool) -> list[Row]:
    """Of each sensor the mean coverage of its specimens, and each of them."""
    found = []
    for sensor in SENSORS:
        what = f"{sensor.what}: held-out inputs in the 90 % band, %"
        if quick:
            reason = "left to the full run: two fits of each specimen take minutes"
            found.append(judged(what, np.nan, LOW)._replace(met=None, reason=reason))
            continue
        found += _of_one(sensor, what, data_folder())
    return found


def _of_one(sensor: Sensor, what: str, folder: Path) -> list[Row]:
    place = folder / sensor.file if isinstance(sensor.file, str) else folder
    if not place.exists():
        return [noted(what, np.nan, reason="the data are not here")]
    with tempfile.TemporaryDirectory() as out:
        file = place if isinstance(sensor.file, str) else sensor.file(folder, Path(out))
        records, _ = sensor.selection.records(sensor.selection.read(file))
    shares = {name: _share(sensor, *pair) for name, pair in records.items()}
    mean = float(np.mean([*shares.values()]))
    row = Row(what, mean, LOW, None, LOW <= mean <= HIGH, at_least=True)
    each = [noted(f"    {name}", share) for name, share in shares.items() if len(shares) > 1]
    return [row, *each]


def _share(sensor: Sensor, train: Record, test: Record | None) -> float:
    assert test is not None
    first, rest = sensor.cut(train)
    short = fit(first, test=rest, model=sensor.model)
    whole = fit(train, test=test, model=sensor.model)
    assert short.test is not None
    assert whole.test is not None
    learnt = calibrated(_ensemble(short), short.test, ahead=sensor.ahead)
    band = learnt.around(_ensemble(whole))
    low, high = np.asarray(estimate(band, whole.test).quantile(np.array([0.05, 0.95])))
    inside = (low <= whole.test.input) & (whole.test.input <= high)
    return 100 * float(np.mean(inside[whole.test.mask]))


def _ensemble(fitted: FitResult) -> AbstractCompensator:
    """Of a few draws."""
    posterior = sample(fitted, steps=25, ensembles=4)
    count = posterior.draws.shape[0] * posterior.draws.shape[1]
    few = np.linspace(0, count - 1, DRAWS).astype(int)
    return invert(jax.tree.map(lambda leaf: leaf[few], posterior.model))


def main(arguments: Sequence[str] | None = None) -> None:
    """Fit every sensor and print the table."""
    chosen = options("benchmarks._compensation.bands", __doc__, arguments)
    jax.config.update("jax_enable_x64", True)
    report(band_rows(chosen.quick), chosen.json)


if __name__ == "__main__":
    main(sys.argv[1:])
