"""When an exported compensator says OK, and whether that is true."""

import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import hysid
import identify
from compensate import Status, calibrated, invert, runtime
from compensate.guards._guarded import UNSTATED
from hysid.commands._asked import Export
from hysid.commands._demo import demo_data
from hysteresis import Preisach, Record
from hysteresis.internal import FoamBlock
from hysteresis.preisach import GaussianDensity
from tests.problems import INVERTIBLE

from .._measure import Row, judged, noted

FOAMS = Path(__file__).parents[3] / "shared/data/foam-midsole-compression/tidy.csv"
MODELS, STARTS, ROWS, TURN, NOISE = 10, 100, 256, 8, 0.003
"""Models, histories before the first reading of each, rows, rows between turning points, and noise in parts
of the readings' range."""


def rows(quick: bool) -> list[Row]:
    """OK shares of exported files over their own records, and OK estimates that are far off."""
    shares = {name: _ok_share(fit) for name, fit in _fits(quick)}
    found = [
        judged(
            f"OK share, own record, unknown start, after the first full cycle: {name}",
            share, 0.9, at_least=True,
        )
        for name, share in shares.items()
    ]  # fmt: skip
    if not FOAMS.exists():
        found.append(noted("OK share, measured foams", np.nan, reason="no measured data at hand"))
    return [*found, *_false(2 if quick else MODELS, 10 if quick else STARTS)]


def _fits(quick: bool) -> Iterator[tuple[str, identify.FitResult]]:
    with tempfile.TemporaryDirectory() as folder:
        record = hysid.read_csv(
            demo_data(Path(folder)), input="force (N)", output="displacement (mm)", time="time (s)"
        )
    yield "demo", hysid.fit(record, test_cycles=3)
    yield "grid to 90 %", hysid.fit(_grid(), "Preisach", test_cycles=2)
    for k, thickness in enumerate((20.0, 30.0, 40.0, 60.0)[: 1 if quick else 4]):
        t, force, gap, _ = FoamBlock(thickness_mm=thickness).five_cycles(noise=0.05, seed=k)
        yield (
            f"virtual foam of {thickness:g} mm",
            hysid.fit(Record.from_arrays(force, gap, t), test_cycles=1),
        )
    if FOAMS.exists() and not quick:
        whole = hysid.read_csv(
            FOAMS, input="force_N", output="compression_mm", time="time_s", group="sample"
        )
        for label, rows_ in list(whole.sequences())[:4]:
            time = None if whole.time is None else whole.time[rows_]
            one = Record.from_arrays(
                whole.input[rows_], whole.output[rows_], time, mask=whole.mask[rows_]
            )
            yield f"foam {label}", hysid.fit(one, test_cycles=3, purpose="compensate")


def _grid() -> Record:
    """Thirty runs to 0.9 of what a sensor was trained on once, by relays that are off every grid."""
    model = Preisach(
        GaussianDensity(0.0, 1.0, 1.0, 0.5, 0.1, 0.15, 0.1), reversible=np.full(8, 0.05)
    )
    ends = np.concatenate([[0.0, 1.0, 0.0], np.tile([0.9, 0.0], 29)])
    u = np.interp(np.arange(0, len(ends) - 1, 1 / 40), np.arange(len(ends)), ends)
    y = np.asarray(model.simulate(None, u))
    noise = 0.002 * np.ptp(y) * np.random.default_rng(1).standard_normal(len(y))
    return Record.from_arrays(u, y + noise)


def _ok_share(fit: identify.FitResult) -> float:
    """Of the exported file over the record it was made of, after the first full cycle of each sequence."""
    with tempfile.TemporaryDirectory() as folder:
        identify.save(fit, Path(folder) / "fit")
        Export(folder=Path(folder) / "fit", runtime=Path(folder) / "it.json").run()
        it = runtime.load(Path(folder) / "it.json")
    record, ok = fit.train, []
    for _, rows_ in record.sequences():
        it.reset()
        time = np.arange(len(record), dtype=float) if record.time is None else record.time
        dt = np.diff(time[rows_], prepend=time[rows_.start])
        run = zip(dt.tolist(), record.output[rows_].tolist(), strict=True)
        status = np.array([it.step(*now).status for now in run])
        cycle = record.cycle[rows_]
        later = record.mask[rows_] & (cycle > cycle.min())
        ok += (status[later] == Status.OK).tolist()
    return float(np.mean(ok))


def _walk(random: np.random.Generator, low: float, high: float, rows: int) -> np.ndarray:
    """Between turning points that are drawn anew, eight rows apart."""
    turns = random.uniform(low, high, rows // TURN + 2)
    return np.interp(np.arange(rows) / TURN, np.arange(len(turns)), turns)


def _false(models: int, starts: int) -> list[Row]:
    """Estimates with status OK that miss by more than three deviations, for histories drawn anew.

    Once without noise, with a stated deviation of a hundredth of the range: what the start alone does. Once
    with noise, and the deviation that the training record teaches.
    """
    wrong, known = np.zeros(2, int), np.zeros(2, int)
    for problem in INVERTIBLE[:: max(len(INVERTIBLE) // models, 1)][:models]:
        model, random = problem.model(), np.random.default_rng(4)
        low, high, t = problem.low, problem.high, np.arange(2.0 * ROWS)
        past = (t[:ROWS], _walk(random, low, high, ROWS))
        y = np.asarray(model.simulate(*past))
        sigma = NOISE * float(np.ptp(y))
        record = Record.from_arrays(past[1], y + sigma * random.standard_normal(ROWS), t[:ROWS])
        band = calibrated(invert(model, trained=(low, high)), record)
        stated = UNSTATED * (high - low), float(np.median(np.asarray(band.error)))
        alone, own = (
            invert(model, trained=(low, high), start="unknown", past=past, deviation=one)
            for one in stated
        )
        for _ in range(starts):
            u = _walk(random, low, high, 2 * ROWS)
            y = np.asarray(model.simulate(t, u))[ROWS:]
            noise = sigma * random.standard_normal(ROWS)
            found = alone.simulate(t[:ROWS], y), band.around(own).simulate(t[:ROWS], y + noise)
            deviations = stated[0], np.asarray(found[1].deviation)
            for k, (one, deviation) in enumerate(zip(found, deviations, strict=True)):
                ok = np.asarray(one.status) == Status.OK
                off = np.abs(np.asarray(one.value) - u[ROWS:]) > 3 * deviation
                wrong[k] += (ok & off).sum()
                known[k] += ok.sum()
    text = f"false OK, % beyond 3 deviations, {models * starts:,} random starts, {models} models"
    shares = 100 * wrong / np.maximum(known, 1)
    return [
        judged(f"{text}, no noise", float(shares[0]), 1.0),
        judged(f"{text}, noise of {100 * NOISE:g} %", float(shares[1]), 1.0),
    ]
