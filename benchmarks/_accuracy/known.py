"""Known pasts: models and compensators that start in the middle of a history, and the ferrite's sequences.

Virtual: each model of the tests runs through a random history of which 40 rows are known, with noise of a
fiftieth of the output's standard deviation. Measured: the error of each sequence in parts of its rms, over
the rows that the challenge asks for, as it counts them (SRE).
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

import hysid
from compensate import Status, invert
from hysid.intake._selection import Selection
from hysteresis import InputError, Record, read_csv
from hysteresis.internal import with_units
from hysteresis.records._csv import with_known
from identify.records._sequence_terms import by_sequence, sequence_error
from tests.problems import PROBLEMS, Problem, random_histories

from .._measure import Row, judged, noted
from . import network

SEQUENCES = "ferrite, mean SRE, %"
KNOWN = "known pasts"
"""What `--only` has to be part of for these rows."""

FIRST, LAST, ROWS, NOISE = 50, 90, 120, 0.02
SEEDS = 5
WORSE, SRE = 1.1, 6.3
"""The error over that with the true state, and per cent of a sequence's rms."""


def rows(folder: Path) -> Iterator[Row]:
    """Of the models, their compensators, and the ferrite if it is there."""
    ratios, sound = [], []
    for problem in PROBLEMS:
        ratios += [_ratio(problem, seed) for seed in range(SEEDS)]
        if "no-inverse" not in problem.tags and (found := _is_sound(problem)) is not None:
            sound.append(found)
    count = len(PROBLEMS) * SEEDS
    yield judged(
        f"error over that with the true state, median of {count}", float(np.median(ratios)), WORSE
    )
    yield noted(f"the same, nine of ten of {count}", float(np.quantile(ratios, 0.9)))
    what = f"compensators OK from the first reading after a known loop, of {len(sound)}, %"
    yield judged(what, 100 * float(np.mean(sound)), 100.0, at_least=True)
    file = folder / "magnet-3c90" / "tidy.csv"
    if file.exists():
        yield from _ferrite(file)
    else:
        yield noted(SEQUENCES, float("nan"), reason="the data are not here")


def _history(problem: Problem, seed: int) -> tuple[np.ndarray, np.ndarray]:
    random = np.random.default_rng(seed)
    (u,) = random_histories(random, problem.low, problem.high, (1, ROWS))
    return np.cumsum(random.uniform(0.2, 2, ROWS)), u


def _ratio(problem: Problem, seed: int) -> float:
    t, u = _history(problem, seed)
    model = with_units(problem.model(seed), None, (problem.low, problem.high))
    y, own = np.asarray(model.simulate(t, u)), slice(FIRST, LAST)
    sigma = NOISE * (float(np.std(y)) or 1.0)
    read = y + sigma * np.random.default_rng(seed).normal(size=ROWS)
    state = model.state_from(t[own], u[own], read[own])
    after = np.asarray(model.simulate(t[LAST:], u[LAST:], state)) - y[LAST:]
    return float(np.sqrt(1 + np.mean(after**2) / sigma**2))


def _is_sound(problem: Problem) -> bool | None:
    """None where the compensator refuses the clock."""
    t, u = _history(problem, 0)
    span, own = problem.high - problem.low, slice(FIRST, LAST)
    u[own] = problem.low + span * (0.5 - 0.4 * np.cos(np.linspace(0, 2 * np.pi, LAST - FIRST)))
    model = with_units(problem.model(1), None, (problem.low, problem.high))
    y, ends = np.asarray(model.simulate(t, u)), (problem.low, problem.high)
    try:
        guard = invert(model, trained=ends, start="unknown", past=(t, u), deviation=span / 100)
        state = guard.state_from(t[own], u[own], y[own])
        return bool(guard.simulate(t[LAST:], y[LAST:], state).status[0] == Status.OK)
    except InputError as error:
        if error.code != "unstable-step":
            raise
        return None


def frozen(folder: Path) -> Row:
    """Train the networks on the ferrite's training sequences, and keep their error behind known samples."""
    train, test, begun = _sequences(folder / "magnet-3c90" / "tidy.csv")
    later = test.noted("later", "after the known samples", mask=~_rows(begun[1]))
    pairs = [(by_sequence(train), with_known(begun[1], "known"))]
    entry = network.freeze(SEQUENCES, pairs, lambda _, found: sequence_error(later, found))
    return noted(f"{SEQUENCES}: network of {entry['parameters']} parameters", entry["error"])


def _sequences(file: Path) -> tuple[Record, Record, list[Record]]:
    """Training and test sequences, and the same with a column of their known samples."""
    counts = read_csv(file.with_name("sequences.csv"), "sequence", "known samples")
    known = dict(zip(counts.input.astype(int).astype(str), counts.output, strict=True))
    selection = Selection(
        "B (T)", "H (A/m)", "t (s)", group=("sequence",), test_where=("sequence%5=0",)
    )
    ((train, test),) = selection.records(selection.read(file))[0].values()
    assert test is not None
    begun = [
        record.noted(
            "known", "known samples", columns={**record.columns, "known": _of(record, known)}
        )
        for record in (train, test)
    ]
    return train, test, begun


def _ferrite(file: Path) -> Iterator[Row]:
    _, test, begun = _sequences(file)
    if (rival := network.frozen().get(SEQUENCES)) is not None:
        what = f"{SEQUENCES}: network of {rival['parameters']} parameters"
        yield noted(what, rival["error"])
    virgin = hysid.fit(begun[0], "auto")
    later = test.noted("later", "after the known samples", mask=~_rows(begun[1]))
    without = sequence_error(later, virgin.predict(test))
    yield noted(f"{SEQUENCES}: auto from the virgin state", without)
    told = sequence_error(later, virgin.predict(begun[1], known="known"))
    yield noted(f"{SEQUENCES}: the same fit, the past told from the known samples", told)
    found = hysid.fit(begun[0], "auto", test=begun[1], known="known", score="sre")
    value = sequence_error(later, found.predict(begun[1], known="known"))
    yield judged(f"{SEQUENCES}: fitted so, --score sre ({found.name})", value, SRE)


def _of(record: hysid.Record, known: dict[str, float]) -> np.ndarray:
    sizes = np.diff([*record.starts, len(record)])
    return np.repeat([known[label] for label in record.labels], sizes)


def _rows(record: hysid.Record) -> np.ndarray:
    sizes = np.diff([*record.starts, len(record)])
    return np.arange(len(record)) - np.repeat(record.starts, sizes) < record.columns["known"]
