"""How long the paper's network takes to train, beside the same in PyTorch's ordinary loop."""

import itertools
import time

import jax
import numpy as np

from hysid.reproduction._skin import READING
from hysid.soft_sensor._force_training import BATCH, staircase_squares
from hysteresis.internal import StaircaseNetwork
from hysteresis.rigs import MicrochannelRig
from identify.internal import train

from .._measure import Row, judged, noted

EPOCHS, TIMED = 1000, 20
PAPERS_S = 331.0


def training_rows(quick: bool) -> list[Row]:
    """Seconds of the paper's 1,000 epochs from those of a few."""
    record = MicrochannelRig().cnc_loops()
    t, F, z = record.time, record.force[:, 0], record.reading[:, 0]
    start = StaircaseNetwork.random([z], [F], [t], jax.random.key(0), **READING)
    x = np.asarray(start.prepare(t, z))
    clock = []
    train(
        start, staircase_squares, (x, F), epochs=TIMED, batch=BATCH, float32=True,
        progress=lambda done, *_: clock.append((done, time.perf_counter())),
    )  # fmt: skip
    (first, begin), (last, end) = clock[0], clock[-1]
    seconds = EPOCHS * (end - begin) / (last - first)  # the first epoch is compiled too
    what = f"(A) training, {len(F):,} readings, {EPOCHS:,} epochs (from {last - first}), s"
    rows = [judged(what, seconds, PAPERS_S)]
    ratio = "(A) training, the same to PyTorch's ordinary loop"
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
