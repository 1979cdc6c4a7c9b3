"""Lines above first contact, fitted in closed form: as many fits as a law needs, without compiling."""

from dataclasses import replace

import numpy as np

from hysteresis import LinearSponge, Record
from identify import FitResult
from identify.internal import Parameter, block_errors, estimate_noise, metrics
from identify.noise._model import NoiseModel

THRESHOLD = 1.5


def pressed(K: float, b: float, seed: int, noise: float = 0.3) -> tuple[Record, Record]:
    """Six presses from 0 to 20 N of a sponge d = K F + b, the last of them held out."""
    F = np.abs((np.arange(240) / 20 + 1) % 2 - 1) * 20
    d = np.where(F >= THRESHOLD, K * F + b, 0.0)
    d = d + np.random.default_rng(seed).normal(0, noise, len(F))
    named = {"input_unit": "N", "output_unit": "mm"}
    named |= {"input_name": "force", "output_name": "displacement"}
    return Record.from_arrays(F, d, **named).split_cycles(1)


def line(train: Record, test: Record, slope: float | None = None) -> FitResult:
    """Least squares of K and b, or of b alone with a given slope; white residuals."""
    touching = train.mask & (train.input >= THRESHOLD)
    F, d = train.input[touching], train.output[touching]
    columns = np.stack([F, np.ones_like(F)], 1)[:, slope is not None :]
    given = 0.0 if slope is None else slope * F
    free = np.linalg.lstsq(columns, d - given, rcond=None)[0]
    K, b = free if slope is None else (slope, *free)
    model = LinearSponge(K=K, b=b, threshold=THRESHOLD)
    residuals = np.asarray(model.simulate(None, train.input)) - train.output
    noise = estimate_noise([residuals[train.mask]], len(free))
    covariance = np.linalg.inv(columns.T @ columns) * noise.sigma**2
    errors = np.sqrt(np.diagonal(covariance))
    listed = (
        Parameter("K", float(K), "mm / N", float(errors[0]) if slope is None else None, "free"),
        Parameter("b", float(b), "mm", float(errors[-1]), "free"),
        Parameter("threshold", THRESHOLD, "N", None, "fixed"),
    )
    if slope is not None:
        listed = (listed[0]._replace(status="fixed"), *listed[1:])
    blocks = np.array(block_errors(residuals[train.mask]))
    fit = FitResult(
        name="LinearSponge", model=model, parameters=listed, covariance=covariance,
        residuals=np.where(train.mask, residuals, np.nan),
        metrics={"train": metrics(train.output, train.output + residuals, train.mask)}, success=True,
        score=100 * float(np.sqrt(blocks.mean()) / np.ptp(train.output[train.mask])), noise=noise,
        train=train, test=test, blocks=blocks, used=train.mask, noise_model=NoiseModel(noise.sigma),
    )  # fmt: skip
    figures = metrics(test.output, fit.predict(test), test.mask)
    return replace(fit, metrics={**fit.metrics, "test": figures})
