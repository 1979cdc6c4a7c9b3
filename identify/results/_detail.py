"""The kinds of fit: what each holds beside parameters, and what follows from it.

A new kind of fit is a class here, a member of `Detail`, and a branch of `sample` where it has its own
posterior.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, TypeAlias

import numpy as np
from jaxtyping import Float

from hysteresis import AbstractModel, Record
from hysteresis._serialisation import decoded
from hysteresis.curves import PolynomialCurve
from hysteresis.running import numbers_of, run

from ..linear._composition import CompositionUnknowns
from ..linear._conditioned_unknowns import ConditionedUnknowns
from ..linear._linear_fit import KnownSums, LinearFit
from ..linear._preisach_unknowns import GridUnknowns
from ..spectra._extrapolation import Allowed
from ..spectra._of_record import PARTS, angular, answers_on, is_moduli, is_survey
from ..spectra._prony_series import Input, Way
from ..spectra._spectrum import Spectrum
from ..spectra._superposition import Shifts
from ._motion_detail import Motion

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
        meaning = self.linear.meaning
        return isinstance(meaning, ConditionedUnknowns) or not meaning.shares

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
