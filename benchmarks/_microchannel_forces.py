"""Forces of one and of two contacts on virtual microchannel sensors, and what their training takes."""

import itertools
import time
from collections.abc import Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax
import scipy.signal

from compensate.microchannel import (
    ChannelSensor,
    EverettNetwork,
    ForceEstimator,
    ForceNetwork,
    MotionFilter,
    MultiContactEstimator,
    SearchEstimator,
    windows,
)
from hysteresis.networks import StaircaseNetwork
from hysteresis.rigs import ChannelRecord, MicrochannelRig
from identify import train

from ._measure import Row, judged, least_seconds, noted

SESSIONS, LENGTH = 28, 2025
"""56,700 readings in records that begin with the sensor at rest, as the loops to be judged on do."""

READING = {"thresholds": (0.1, 0.2, 0.4, 0.8), "lags": (0.03, 0.06, 0.12, 0.25, 1.0, 5.0)}
FORCE = {"thresholds": (0.1, 0.2, 0.35, 0.6, 1.0, 1.6, 2.6), "lags": (0.02, 0.2, 1.0, 8.0)}
"""What each network sees: half widths of plays in V or N, delays in s; chosen on another seed's sensor."""

HIGH_N, NOISE_V, DELAY = 8.5, 0.0205, 5
BATCH, EPOCHS, TIMED = 64, 1000, 20
PAIR, PAIR_SAMPLES, PAIR_DT = (1, 3), (3960, 3651), 0.05
PAPERS_S = 331.0

MACHINE_FORCE, RATES_N_PER_S, TURNS_PER_S = 7.8, (2.0, 20.0), 1.5
"""How the machine moves, for the floor."""


def force_rows(quick: bool) -> list[Row]:
    """Rows of the forces of single contacts, their training, and of two contacts."""
    return [*_single_rows(quick), *_training_rows(), *_pair_rows(quick)]


class Records(NamedTuple):
    """Single presses: one array for each record."""

    time: list[np.ndarray]
    force: list[np.ndarray]
    reading: list[np.ndarray]


def _records(found: Sequence[ChannelRecord], location: int, layer: int = 0) -> Records:
    return Records(
        [one.time for one in found],
        [one.force[:, location] for one in found],
        [one.reading[:, layer] for one in found],
    )


def _rms(errors: Sequence[np.ndarray]) -> float:
    return float(np.sqrt(np.mean(np.concatenate([e.ravel() for e in errors]) ** 2)))


def _decaying(rate: float, steps: int) -> optax.GradientTransformation:
    return optax.adam(optax.cosine_decay_schedule(rate, max(1, steps)))


def _squares(network: StaircaseNetwork, rows: Any, key: Any) -> jax.Array:
    return jnp.mean((network.evaluate(rows[0]) - rows[1]) ** 2)


def _sequence_squares(network: EverettNetwork, rows: Any, key: Any) -> jax.Array:
    t, reading, force = rows
    return jnp.mean((jax.vmap(network.simulate)(t, reading) - force) ** 2)


def _learnt(
    inputs: Any, outputs: Any, times: Any, epochs: int, rate: float = 2e-3, **sees: Any
) -> tuple[StaircaseNetwork, float]:
    """A network of records, and its error on the tenth of the rows it did not learn from."""
    start = StaircaseNetwork.random(inputs, outputs, times, jax.random.key(0), **sees)
    x = np.concatenate(
        [np.asarray(start.prepare(t, u)) for t, u in zip(times, inputs, strict=True)]
    )
    y = np.concatenate(outputs)
    steps = epochs * (9 * len(y) // (10 * BATCH))
    found = train(
        start, _squares, (x, y), epochs=epochs, batch=BATCH, float32=True,
        optimizer=_decaying(rate, steps),
    )  # fmt: skip
    return found.module, float(np.sqrt(found.validation[found.best]))


# (A) One contact


def _single_rows(quick: bool) -> list[Row]:
    seeds = range(1) if quick else range(3)
    found = [_single(seed, quick) for seed in seeds]
    mean = {name: float(np.mean([one[name] for one in found])) for name in found[0]}
    late = f"{DELAY} readings late"
    return [
        judged("(A) (i) the paper's network with delayed readings, RMSE, N", mean["network"], 0.055),
        noted("    as the paper describes it, without time", mean["staircase"]),
        noted("(A) (ii) monotone Everett network, RMSE, N", mean["everett"]),
        judged(f"(A) (iii) sensor's network run backwards, {late}, RMSE, N", mean["late"], 0.03),
        noted("    as the readings come", mean["now"]),
        noted("    floor, the rig's own law known: as the readings come", mean["floor"]),
        noted(f"    floor: the same, {late}", mean["floor_late"]),
        noted("    readings within its 90 % band, as they come, %", mean["held"]),
    ]  # fmt: skip


def _single(seed: int, quick: bool) -> dict[str, float]:
    """RMSE of every kind over the four loops of four sessions."""
    rig = MicrochannelRig(seed=seed)
    taught = _records([rig.cnc_loops(LENGTH, session=100 + k) for k in range(SESSIONS)], 0)
    loops = [loop for session in range(4) for loop in rig.test_loops(session=session)]
    test = _records(loops, 0)
    t, F, z = taught
    epochs = 200 if quick else EPOCHS
    figures = {}
    for name, sees in {"network": READING, "staircase": {**READING, "lags": ()}}.items():
        figures[name] = _direct(*_learnt(z, F, t, epochs, **sees), test)
    figures["everett"] = _direct(*_everett(taught, 150 if quick else 600), test)
    forward, off = _learnt(F, z, t, epochs, 3e-3, **FORCE)
    steady = {"acceleration": 2.0, "turn": 10.0, "turns": 1.5, "delay": DELAY}
    own = MultiContactEstimator(
        ChannelSensor([forward]), max(off, NOISE_V), MotionFilter(HIGH_N, **steady)
    )
    figures["now"], figures["late"], held = _filtered(own, test)
    figures["held"] = 100 * held
    figures["floor"], figures["floor_late"] = floor(rig, test)
    return figures


def _direct(model: Any, off: float, test: Records) -> float:
    estimator = ForceEstimator(model, off, HIGH_N)
    length = max(map(len, test.time))
    errors = []
    for t, F, z in zip(*test, strict=True):
        found = estimator.simulate(_padded(t, length), _padded(z, length))
        errors.append(np.asarray(found.value)[: len(F)] - F)
    return _rms(errors)


def _filtered(estimator: MultiContactEstimator, test: Records) -> tuple[float, float, float]:
    """RMSE as readings come and late, and the part of the former within 90 % bands."""
    length, now, late, held = max(map(len, test.time)), [], [], []
    for t, F, z in zip(*test, strict=True):
        found = estimator.simulate(_padded(t, length), _padded(z, length)[:, None])
        now.append(np.asarray(found.value)[: len(F), 0] - F)
        late.append(np.asarray(found.late)[DELAY : len(F), 0] - F[:-DELAY])
        held.append(np.abs(now[-1]) < 1.645 * np.asarray(found.deviation)[: len(F), 0])
    return _rms(now), _rms(late), float(np.concatenate(held).mean())


def _padded(values: np.ndarray, length: int) -> np.ndarray:
    """Repeated at the end, so that one length is compiled."""
    return np.pad(values, (0, length - len(values)), mode="edge")


def _everett(taught: Records, epochs: int) -> tuple[EverettNetwork, float]:
    t, F, z = (jnp.asarray(np.stack(part)) for part in taught)
    start = EverettNetwork.random(jax.random.key(0), high=float(z.max()), force=HIGH_N)
    found = train(
        start, _sequence_squares, (t, z, F), batch=5, epochs=epochs,
        optimizer=_decaying(2e-2, epochs * (SESSIONS * 9 // 50)),
    )  # fmt: skip
    return found.module, float(np.sqrt(found.validation[found.best]))


def floor(rig: MicrochannelRig, test: Records, particles: int = 16_000) -> tuple[float, float]:
    """RMSE of the mean of all forces that could have made the readings, as they come and late.

    A particle filter that knows the rig's own law and how the machine moves; no estimator of the same
    readings can do better but by chance.
    """
    random = np.random.default_rng([rig.seed, 7])
    now, late = [], []
    for t, F, z in zip(*test, strict=True):
        mean, then = _particles(rig, float(t[1] - t[0]), z, particles, random)
        now.append(mean - F)
        late.append(then[DELAY:] - F[:-DELAY])
    return _rms(now), _rms(late)


def _particles(
    rig: MicrochannelRig, dt: float, z: np.ndarray, count: int, random: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Mean force at every reading, and of `DELAY` readings before it."""
    gain = float(rig.readout.scale * rig.gains[0, 0])
    r, share = np.array(rig.stop_travel_n)[:, None], np.array(rig.stop_share)[:, None]
    creep, kept = np.array(rig.creep), np.exp(-dt / np.array(rig.creep_s))[:, None]
    through = float(np.exp(-dt / rig.readout.low_pass_s))
    F, rate, read = np.zeros((3, count))
    slow, fast = np.log(RATES_N_PER_S)
    s, q = np.zeros((len(r), count)), np.zeros((len(creep), count))
    past, mean, then = np.zeros((DELAY + 1, count)), [], []
    for k, reading in enumerate(z):
        turns = (random.random(count) < TURNS_PER_S * dt) | (k == 0)
        fresh = -np.where(rate == 0, -1.0, np.sign(rate))
        fresh *= np.exp(random.uniform(slow, fast, count))
        when = random.random(count)  # of the step, before the turn
        moved = F + dt * np.where(turns, when * rate + (1 - when) * fresh, rate)
        rate = np.where(turns, fresh, rate)
        rate = np.where((moved < 0) | (moved > MACHINE_FORCE), -rate, rate)
        moved = np.clip(moved, 0.0, MACHINE_FORCE)
        s, F = np.clip(s + moved - F, -r, r), moved
        rub = rig.friction * -np.expm1(-F / rig.friction_onset_n) * (share * s / r).sum(0)
        u = F / (1 - F / rig.closing_force_n) * (1 - rub)
        q = kept * q + (1 - kept) * u
        v = (1 - creep.sum()) * u + creep @ q
        read = through * read + (1 - through) * gain * v
        past = np.vstack([F[None], past[:-1]])
        log = -0.5 * ((reading - read) / rig.readout.noise) ** 2
        weight = np.exp(log - log.max())
        weight /= weight.sum()
        mean.append(weight @ F)
        then.append(weight @ past[-1])
        at = np.searchsorted(np.cumsum(weight), (random.random() + np.arange(count)) / count)
        at = np.minimum(at, count - 1)
        F, rate, read, s, q, past = F[at], rate[at], read[at], s[:, at], q[:, at], past[:, at]
    return np.array(mean), np.array(then)


# Training


def _training_rows() -> list[Row]:
    rig = MicrochannelRig()
    record = rig.cnc_loops()
    t, F, z = record.time, record.force[:, 0], record.reading[:, 0]
    start = StaircaseNetwork.random([z], [F], [t], jax.random.key(0), **READING)
    x = np.asarray(start.prepare(t, z))
    clock = []
    train(
        start, _squares, (x, F), epochs=TIMED, batch=BATCH, float32=True,
        progress=lambda done, *_: clock.append((done, time.perf_counter())),
    )  # fmt: skip
    (first, begin), (last, end) = clock[0], clock[-1]
    seconds = EPOCHS * (end - begin) / (last - first)  # the first epoch is compiled too
    what = f"(A) training, {len(F):,} readings, {EPOCHS:,} epochs (from {last - first}), s"
    rows = [judged(what, seconds, PAPERS_S)]
    ratio = "(A) the same to PyTorch's ordinary loop"
    try:
        theirs = EPOCHS * _torch_epoch(x, F)
    except ImportError:
        return [*rows, Row(ratio, float("nan"), 0.2, reason="pip install torch to measure it")]
    return [*rows, judged(ratio, seconds / theirs, 0.2), noted("    PyTorch, s", theirs)]


def _torch_epoch(x: np.ndarray, y: np.ndarray) -> float:
    """Seconds of an epoch of the same network, data and batches, the second of two."""
    import torch  # type: ignore[import-not-found]

    torch.manual_seed(0)
    nine = 9 * len(y) // 10
    scaled = (x - x.mean(0)) / np.where(x.std(0) > 0, x.std(0), 1.0)
    rows = (torch.tensor(part[:nine], dtype=torch.float32) for part in (scaled, y[:, None]))
    loader = torch.utils.data.DataLoader(
        torch.utils.data.TensorDataset(*rows), batch_size=BATCH, shuffle=True
    )
    sizes = (x.shape[1], 25, 12, 1)
    layers = [torch.nn.Linear(*pair) for pair in itertools.pairwise(sizes)]
    network = torch.nn.Sequential(layers[0], torch.nn.ReLU(), layers[1], torch.nn.ReLU(), layers[2])
    optimizer, loss = torch.optim.Adam(network.parameters()), torch.nn.MSELoss()
    seconds = 0.0
    for _ in range(2):
        begin = time.perf_counter()
        for some, wanted in loader:
            optimizer.zero_grad()
            loss(network(some), wanted).backward()
            optimizer.step()
        seconds = time.perf_counter() - begin
    return seconds


# (D) Two contacts


def _pair_rows(quick: bool) -> list[Row]:
    """Networks and channels learn from a machine's presses of one location at a time."""
    found = [_pair(seed, quick) for seed in (range(1) if quick else range(3))]
    mean = {name: float(np.mean([one[name] for one in found])) for name in found[0]}
    why = "its networks need minutes to learn: without --quick" if quick else ""
    peaks = Row("(D) peaks of 16, paper's method", mean["peaks"], 16.0, reason=why, at_least=True)
    ratio = Row(
        "(D) RMSE, ours to the paper's method, placed presses", mean["ratio"], 0.5, reason=why
    )
    if not quick:
        peaks, ratio = (
            peaks._replace(met=mean["peaks"] >= 16),
            ratio._replace(met=mean["ratio"] <= 0.5),
        )
    return [
        peaks,
        ratio,
        judged("(D) step of the paper's method to ours", mean["speed"], 50.0, at_least=True),
        noted("    RMSE, placed presses, ours, N", mean["ours"]),
        noted("    paper's, N", mean["paper"]),
        noted("    peaks of 16, ours", mean["our_peaks"]),
        noted("    RMSE, a finger's presses, ours, N", mean["finger"]),
        noted("    paper's, N", mean["finger_paper"]),
        noted("    ours, step, us", mean["step_us"]),
    ]  # fmt: skip


def _pair(seed: int, quick: bool) -> dict[str, float]:
    rig = MicrochannelRig(seed=seed)
    taught = [
        [
            rig.cnc_loops(count // 10, location=place, dt=PAIR_DT, session=10 * place + k)
            for k in range(10)
        ]
        for place, count in zip(PAIR, PAIR_SAMPLES, strict=True)
    ]
    ours = channels(taught, PAIR)
    paper = SearchEstimator(
        [
            _recurrent(found, place, 4 if quick else 100)
            for found, place in zip(taught, PAIR, strict=True)
        ]
    )
    figures = {}
    for name, finger in (("", False), ("finger", True)):
        pressed = [rig.simultaneous(finger=finger, session=session) for session in range(2)]
        truth = [one.force[:, PAIR] for one in pressed]
        mine = [np.asarray(ours.simulate(one.time, one.reading).value) for one in pressed]
        theirs = [np.asarray(paper.simulate(one.time, one.reading)) for one in pressed]
        errors = (_rms([a - b for a, b in zip(e, truth, strict=True)]) for e in (mine, theirs))
        figures[name or "ours"], figures[f"{name}_paper" if name else "paper"] = errors
        if not finger:
            figures["peaks"] = min(map(peaks_found, truth, theirs))
            figures["our_peaks"] = min(map(peaks_found, truth, mine))
            one = pressed[0]
            calls = {
                "ours": lambda one=one: ours.simulate(one.time, one.reading).value,
                "paper": lambda one=one: paper.simulate(one.time, one.reading),
            }
    seconds = least_seconds(calls, 2)
    figures |= {
        "ratio": figures["ours"] / figures["paper"],
        "speed": seconds["paper"] / seconds["ours"],
        "step_us": 1e6 * seconds["ours"] / 1452,
    }
    return figures


def channels(
    taught: Sequence[Sequence[ChannelRecord]], places: Sequence[int]
) -> MultiContactEstimator:
    """An estimator of several contacts from records of one location each: a network of every location's
    signal, the layers by its gains, weighted by them, and those gains."""
    models, gains, off = [], [], 0.0
    for found, place in zip(taught, places, strict=True):
        z = np.concatenate([one.reading for one in found])
        strongest = z[:, z.std(0).argmax()]
        gain = z.T @ strongest / (strongest @ strongest)
        signal = [one.reading @ gain / (gain @ gain) for one in found]
        t, F, _ = _records(found, place)
        model, error = _learnt(F, signal, t, 600, 3e-3, **FORCE)
        models.append(model)
        gains.append(gain)
        off = max(off, error * float(np.sqrt(gain @ gain)))
    sigma = [max(off, NOISE_V)] * z.shape[1]
    motion = MotionFilter(HIGH_N, acceleration=10.0, turn=10.0, turns=1.0)
    return MultiContactEstimator(ChannelSensor(models, np.stack(gains, 1)), sigma, motion)


def _recurrent(found: Sequence[ChannelRecord], place: int, epochs: int) -> ForceNetwork:
    forces = np.concatenate([windows(one.force[:, place]) for one in found])
    readings = np.concatenate([one.reading for one in found])
    start = ForceNetwork.random(jax.random.key(place))
    steps = epochs * (9 * len(forces) // (10 * BATCH))
    learnt = train(
        start, _window_squares, (forces, readings), epochs=epochs, batch=BATCH, float32=True,
        patience=10, optimizer=_decaying(2e-3, steps),
    )  # fmt: skip
    return eqx.nn.inference_mode(learnt.module)


def _window_squares(network: ForceNetwork, rows: Any, key: Any) -> jax.Array:
    return jnp.mean((network(rows[0], key) - rows[1]) ** 2)


def peaks_found(truth: np.ndarray, found: np.ndarray) -> int:
    """True peaks that have one of their own among the found, within a second and half to twice as high."""
    count, near = 0, round(1.0 / PAIR_DT)
    for true, estimate in zip(truth.T, found.T, strict=True):
        at, _ = scipy.signal.find_peaks(true, prominence=1.0)
        seen, _ = scipy.signal.find_peaks(estimate, prominence=0.7)
        for k in at:
            close = [j for j in seen if abs(j - k) <= near]
            fits = [j for j in close if 0.5 < estimate[j] / true[k] < 2]
            if fits:
                count += 1
                seen = seen[seen != fits[0]]
    return count
