"""The kinds of fit: what each holds beside parameters, and what follows from it.

A new kind of fit is a class here, a member of `Detail`, and a branch of `sample` where it has its own
posterior.
"""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, TypeAlias, TypedDict

import numpy as np
from jaxtyping import Float

from hysteresis import AbstractModel, Record
from hysteresis._serialisation import decoded
from hysteresis.curves import PolynomialCurve
from hysteresis.running import numbers_of, run

from ..dynamics._linear_approximation import LinearApproximation
from ..dynamics._output_error import RecordedMotion
from ..linear._composition import CompositionUnknowns
from ..linear._conditioned_unknowns import ConditionedUnknowns
from ..linear._linear_fit import KnownSums, LinearFit
from ..linear._preisach_unknowns import GridUnknowns
from ..spectra._extrapolation import Allowed
from ..spectra._of_record import PARTS, angular, answers_on, is_moduli, is_survey
from ..spectra._prony_series import Input, Way
from ..spectra._spectrum import Spectrum
from ..spectra._superposition import Shifts

# The kind of fit that has a motion: an oscillator, its recorder, and the classes that were tried.

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


Words: TypeAlias = dict[str, Any]
Arrays: TypeAlias = Mapping[str, np.ndarray]


@dataclass(frozen=True, eq=False)
class Parametric:
    """A model of few parameters, fitted by maximum likelihood or least squares."""

    kind: ClassVar[str] = "parametric"
    is_linear: ClassVar[bool] = False
    """Whether the unknowns are weights that a prior holds together: they are not counted as parameters."""

    def words(self) -> Words:
        """What fit.json says beside the parameters."""
        return {}

    def arrays(self) -> dict[str, Any]:
        """What fit.npz holds beside the residuals."""
        return {}

    def outputs(self, record: Record) -> np.ndarray | None:
        """The model's output on a record where there is a faster way to it than the model; else None."""
        return None


@dataclass(frozen=True, eq=False)
class GridWeights:
    """The weights of a Preisach model on a grid, fitted by non-negative least squares."""

    linear: LinearFit[GridUnknowns]
    kind: ClassVar[str] = "grid weights"
    is_linear: ClassVar[bool] = True
    key: ClassVar[str] = "unknowns"
    """Under this name fit.json holds it."""

    def words(self) -> Words:
        return {self.key: self.linear.meaning.words()}

    def arrays(self) -> dict[str, Any]:
        return _linear_arrays(self.linear) | {"block": self.linear.meaning.block}

    def outputs(self, record: Record) -> np.ndarray | None:
        return self.linear.outputs(record)

    @classmethod
    def rebuilt(cls, words: Any, arrays: Arrays, model: Any) -> "GridWeights":
        """The inverse of `words` and `arrays`."""
        meaning = decoded(words, GridUnknowns, cls.key)._replace(blocks=np.asarray(arrays["block"]))
        return cls(_linear_fit(meaning, arrays))


@dataclass(frozen=True, eq=False)
class Composition:
    """A sum of parts, each linear in its unknowns, fitted by non-negative least squares.

    `linear.meaning.parts` names the parts.
    """

    linear: LinearFit[CompositionUnknowns] | LinearFit[ConditionedUnknowns]
    kind: ClassVar[str] = "composition"
    is_linear: ClassVar[bool] = True
    key: ClassVar[str] = "composition"

    @property
    def rises(self) -> bool:
        """Whether no weight is negative, so that each part but the strengths rises with the input."""
        return not self.linear.meaning.shares

    def words(self) -> Words:
        meaning = self.linear.meaning
        if isinstance(meaning, ConditionedUnknowns):
            return {self.key: meaning.words()}
        members = [one._asdict() for one in meaning.members]
        return {self.key: meaning._asdict() | {"members": members}}

    def arrays(self) -> dict[str, Any]:
        return _linear_arrays(self.linear) | {"rows": self.linear.rows}

    def outputs(self, record: Record) -> np.ndarray | None:
        return self.linear.outputs(record)

    @classmethod
    def rebuilt(cls, words: Any, arrays: Arrays, model: Any) -> "Composition":
        """The inverse of `words` and `arrays`."""
        kind = ConditionedUnknowns if "knots" in words else CompositionUnknowns
        return cls(_linear_fit(decoded(words, kind), arrays))


@dataclass(frozen=True, eq=False)
class ReversalCurves:
    """A Preisach model read off first-order reversal curves, see `everett_surface`.

    `count`: how many.
    """

    count: int
    kind: ClassVar[str] = "reversal curves"
    is_linear: ClassVar[bool] = True
    key: ClassVar[str] = "reversal_curves"

    def words(self) -> Words:
        return {self.key: self.count}

    def arrays(self) -> dict[str, Any]:
        return {}

    def outputs(self, record: Record) -> np.ndarray | None:
        return None

    @classmethod
    def rebuilt(cls, words: Any, arrays: Arrays, model: Any) -> "ReversalCurves":
        """The inverse of `words` and `arrays`."""
        return cls(decoded(words, int, cls.key))


@dataclass(frozen=True, eq=False)
class FoldedState:
    """Butterfly loops: a composition of a state without a unit, and the curve that makes the output of it.

    `linear.meaning.parts` names the parts of the state.
    """

    linear: LinearFit[CompositionUnknowns]
    curve: PolynomialCurve
    kind: ClassVar[str] = "butterfly"
    is_linear: ClassVar[bool] = True
    key: ClassVar[str] = "butterfly"

    def words(self) -> Words:
        return {self.key: self.linear.meaning._asdict()}

    def arrays(self) -> dict[str, Any]:
        return _linear_arrays(self.linear) | {"rows": self.linear.rows}

    def outputs(self, record: Record) -> np.ndarray | None:
        state = self.linear.outputs(record)
        return None if state is None else folded(self.curve, state)

    @classmethod
    def rebuilt(cls, words: Any, arrays: Arrays, model: Any) -> "FoldedState":
        """The inverse of `words` and `arrays`."""
        return cls(_linear_fit(decoded(words, CompositionUnknowns), arrays), model.parts[-1])


@dataclass(frozen=True, eq=False)
class DiscreteSpectrum:
    """A spectrum of time constants, of creep or relaxation under a constant input or of moduli.

    `shifts`: of the temperatures, where the record has them.
    """

    spectrum: Spectrum
    shifts: Shifts | None = None
    kind: ClassVar[str] = "spectrum"
    is_linear: ClassVar[bool] = False
    key: ClassVar[str] = "spectrum"

    def words(self) -> Words:
        spectrum = self.spectrum
        found = {
            k: getattr(spectrum, k) for k in ("kind", "order", "dense", "step", "span", "notes")
        }
        found["table"] = [row._asdict() for row in spectrum.table]
        found["noise"] = spectrum.noise._asdict()
        if self.shifts is not None:
            found["shifts"] = self.shifts._asdict()
        return {self.key: found}

    def outputs(self, record: Record) -> np.ndarray | None:
        if not is_survey(record):
            return None
        return answers_on(record, self.spectrum.kind, self.spectrum.allowed.fitted, self.shifts)

    def arrays(self) -> dict[str, Any]:
        parts = self.spectrum.allowed._asdict()
        if self.spectrum.way is not None:
            parts |= {"way": np.stack(self.spectrum.way)}
        return {f"spectrum_{name}": x for name, x in parts.items()}

    @classmethod
    def rebuilt(cls, words: Any, arrays: Arrays, model: Any) -> "DiscreteSpectrum":
        """The inverse of `words` and `arrays`; the answers of other orders are not kept."""
        words, kept = dict(words), {}
        for name, x in words.pop("shifts", {}).items():
            kept[name] = np.array(x, float) if name != "constants" and isinstance(x, list) else x
        words |= {
            "model": model,
            "allowed": Allowed(*(arrays[f"spectrum_{name}"] for name in Allowed._fields)),
            "way": Way(*arrays["spectrum_way"]) if "spectrum_way" in arrays else None,
        }
        shifts = decoded(kept, Shifts, "shifts") if kept else None
        return cls(decoded(words, Spectrum, cls.key), shifts)


def answers_over(
    detail: DiscreteSpectrum, record: Record, x: Float[np.ndarray, " rows"]
) -> dict[str, Float[np.ndarray, " rows"]]:
    """The spectrum over frequencies or times at the reference: storage and loss, or the answer itself."""
    kind, answer = detail.spectrum.kind, detail.spectrum.allowed.fitted
    if not is_moduli(record):
        return {"": record.input[0] * answer(Input(kind, x))}
    both = answer(Input(kind, x * angular(record.input_unit), oscillation=True))
    return dict(zip(PARTS, both.reshape(2, -1), strict=True))


def folded(curve: PolynomialCurve, state: Float[np.ndarray, " rows"]) -> Float[np.ndarray, " rows"]:
    """The curve at these states, by its law, which is not compiled for every number of rows."""
    return run(numbers_of(curve.tree()), state, np.zeros(len(state))).value


Detail: TypeAlias = (
    Parametric
    | GridWeights
    | Composition
    | ReversalCurves
    | FoldedState
    | DiscreteSpectrum
    | Motion
)


def detail_of(document: Mapping[str, Any], arrays: Arrays, model: AbstractModel) -> Detail:
    """The kind of a saved fit, from its fit.json and fit.npz."""
    for kind in (GridWeights, Composition, ReversalCurves, FoldedState, DiscreteSpectrum, Motion):
        if kind.key in document:
            return kind.rebuilt(document[kind.key], arrays, model)
    return Parametric()


def _linear_arrays(linear: LinearFit) -> dict[str, Any]:
    # One half of a symmetric matrix: most of the file.
    lower = np.tril(linear.H)
    found = {"at": linear.unknowns, "H": lower, "b": linear.b, "blocks": linear.blocks}
    if linear.known is None:
        return found
    return found | {"sums": linear.known.covariance, "determined": linear.known.determined}


def _linear_fit(meaning: Any, arrays: Arrays) -> LinearFit:
    # What only the fit itself needs, the prior's strength, is not kept.
    rows = int(arrays["rows"]) if "rows" in arrays else int(arrays["used"].sum())
    unknowns, lower, b, blocks = (arrays[name] for name in ("at", "H", "b", "blocks"))
    H = np.tril(lower) + np.tril(lower, -1).T
    known = KnownSums(arrays["sums"], arrays["determined"]) if "sums" in arrays else None
    return LinearFit(unknowns, meaning, H, b, rows, 0.0, blocks, known=known)
