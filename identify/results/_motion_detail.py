"""The kind of fit that has a motion: an oscillator, its recorder, and the classes that were tried."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, TypedDict

import numpy as np

from hysteresis import Record
from hysteresis._serialisation import decoded

from ..dynamics._linear_approximation import LinearApproximation
from ..dynamics._recorded_motion import RecordedMotion

PLANT = "mass", "damping", "stiffness"
OWN = "chi2", "sigma", "classes", "records", "few", "starts"
RECORDED = {k: k for k in ("dt", "period", "initial")} | {
    "oversampling": "substeps",
    "decimation": "stages",
}
"""Entries of fit.json, and of the recorded motion the fields that they hold."""


@dataclass(frozen=True, eq=False)
class Motion:
    """An oscillator that was fitted to a motion.

    - `recorded`: the oscillator with its recorder, which predicts records.
    - `chi2`: mean squared residual of the averaged motion over the variance of its noise: 1 where noise
      alone is left. `sigma`: standard deviation of that noise.
    - `classes`: of each class that was tried: its name, chi2, effective parameters and the Bayesian
      information criterion.
    - `linear`: the best linear approximation.
    - `few`: the hysteresis has few parameters, not weights. `starts`: chi2 of every start of the search.
    - `records`: digests of the forces of the training and of the test record.
    """

    recorded: RecordedMotion
    chi2: float
    sigma: float
    classes: tuple[dict[str, Any], ...]
    linear: LinearApproximation
    records: tuple[str, str]
    few: bool
    starts: tuple[float, ...] = ()
    kind: ClassVar[str] = "motion"
    key: ClassVar[str] = "motion"

    @property
    def is_linear(self) -> bool:
        """Whether the hysteresis has weights that a prior holds together."""
        return not self.few

    def words(self) -> dict[str, Any]:
        linear = {k: getattr(self.linear, k) for k in (*PLANT, "resonance")}
        recorded = {said: getattr(self.recorded, k) for said, k in RECORDED.items()}
        return {self.key: recorded | {k: getattr(self, k) for k in OWN} | {"linear": linear}}

    def arrays(self) -> dict[str, Any]:
        linear = self.linear
        response: Any = linear.response
        return {
            "motion_force": self.recorded.force,
            "motion_frequencies": linear.frequencies,
            "motion_response": np.stack([response.real, response.imag]),
            "motion_noise": linear.noise,
            "motion_distortion": linear.distortion,
        }

    def outputs(self, record: Record) -> np.ndarray | None:
        digest = digest_of(record)
        if digest == self.records[0]:
            return self.recorded.as_fitted(record.input)
        if digest == self.records[1]:
            found = self.recorded.going_on(record)
            if found is not None:
                return found
        return self.recorded.from_rest(record)

    @classmethod
    def rebuilt(cls, words: Any, arrays: Mapping[str, np.ndarray], model: Any) -> "Motion":
        """The inverse of `words` and `arrays`."""
        said: Any = decoded(words, _Words, cls.key)
        recorded = RecordedMotion(
            model, force=arrays["motion_force"], **{k: said[word] for word, k in RECORDED.items()}
        )
        real, imaginary = arrays["motion_response"]
        mass, damping, stiffness = (said["linear"][k] for k in PLANT)
        linear = LinearApproximation(
            mass, damping, stiffness, arrays["motion_frequencies"], real + 1j * imaginary,
            arrays["motion_noise"], arrays["motion_distortion"],
        )  # fmt: skip
        return cls(recorded, linear=linear, **{k: said[k] for k in OWN})


class _Words(TypedDict):
    """What fit.json says of a motion."""

    dt: float
    oversampling: int
    decimation: tuple[int, ...]
    period: int
    initial: tuple[float, float, float]
    chi2: float
    sigma: float
    classes: tuple[dict[str, Any], ...]
    linear: dict[str, float]
    records: tuple[str, str]
    few: bool
    starts: tuple[float, ...]


def digest_of(record: Record | None) -> str:
    """A checksum of a record's input and clock; "" of none."""
    if record is None:
        return ""
    found = hashlib.sha256(np.ascontiguousarray(record.input, float).tobytes())
    if record.time is not None:
        found.update(np.ascontiguousarray(record.time, float).tobytes())
    return found.hexdigest()
