"""Baselines of an output under a held input: a constant, a line in time, a power law of time."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from hysteresis import Record

EXPONENTS = np.linspace(-1, 1, 101).round(2)
"""Tried for a power law; 0 is the logarithm."""


class PowerLaw(NamedTuple):
    """Output over input = level + factor t^exponent, or level + factor log t where the exponent is 0."""

    level: float
    factor: float
    exponent: float


@dataclass(frozen=True)
class HoldBaseline:
    """Creep or relaxation as a power law of the time since the step, by least squares of relative errors;
    where not `relative`, of errors times their weights.

        y = input (level + factor t^n),  with n from `exponents`

    Source: Findley, Lai, Onaran, Creep and Relaxation of Nonlinear Viscoelastic Materials (1976), 2.5.
    """

    name: str
    exponents: tuple[float, ...]
    relative: bool = True

    def prepared(self, record: Record) -> tuple[np.ndarray, np.ndarray]:
        assert record.time is not None
        t = record.time
        # The law has no value at the step itself; the first reading comes later.
        return record.input, np.maximum(t, t[t > 0].min(initial=np.inf))

    def fitted(
        self,
        seen: tuple[np.ndarray, np.ndarray],
        output: np.ndarray,
        rows: np.ndarray,
        weights: np.ndarray,
    ) -> PowerLaw:
        force, t = (x[rows] for x in seen)
        y = output[rows] / force
        weight = 1 / np.abs(y) if self.relative else weights[rows] * np.abs(force)
        best, least = PowerLaw(float(y.mean()), 0.0, 0.0), np.inf
        for exponent in self.exponents:
            columns = np.column_stack([np.ones_like(t), _power(t, exponent)])
            found = np.linalg.lstsq(columns * weight[:, None], y * weight, rcond=None)[0]
            error = float(np.mean((weight * (columns @ found - y)) ** 2))
            if error < least:
                best, least = PowerLaw(float(found[0]), float(found[1]), exponent), error
        return best

    def predicted(
        self, seen: tuple[np.ndarray, np.ndarray], unknowns: PowerLaw
    ) -> Float[np.ndarray, " samples"]:
        force, t = seen
        level, factor, exponent = unknowns
        return force * (level + factor * _power(t, exponent))


def of_holds(relative: bool = True) -> tuple[HoldBaseline, ...]:
    """The simplest first."""
    return (
        HoldBaseline("constant", (), relative),
        HoldBaseline("straight line in time", (1.0,), relative),
        HoldBaseline("power law of time", tuple(EXPONENTS.tolist()), relative),
    )


def _power(t: np.ndarray, exponent: float) -> np.ndarray:
    return np.log(t) if exponent == 0 else t**exponent
