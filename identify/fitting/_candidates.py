"""Which models a fit tries: names, classes and models to start from, in one list."""

from dataclasses import replace
from typing import Any

import numpy as np

from hysteresis import AbstractModel, InputError, Preisach, Record
from hysteresis._registry import OURS, find_model, model_names, registered, similar
from hysteresis.preisach import GridDensity

from .._forc import Forc, everett_surface, forc_curves
from .._levels import HELD
from ..records._folds import held_out_errors
from ..records._new_record import predict
from ..results._detail import ReversalCurves
from ..results._fit_result import FitResult, Parameter
from ..results._goodness_of_fit import evidence
from ._butterfly import ButterflyCandidate
from ._linear import CompositionCandidate, GridCandidate
from ._parametric import SHAPES, ParametricCandidate
from ._training_data import Candidate, Options, TrainingData, Trial

# A Preisach model from a record that consists of first-order reversal curves, without a solver.


FEWEST = 10
"""Curves from different reversals that such a record has."""

SHARE = 0.4
"""Of the rows, on the curves: half of those that also show the ways to the reversals."""


class SurfaceCandidate(Candidate):
    """The Everett function of first-order reversal curves; `"auto"` tries it where a record consists of
    them."""

    def suits(self, data: TrainingData, purpose: str) -> bool:
        # What such curves show best may have no inverse, because noise makes some of its masses negative.
        bars = data.falls or data.condition is not None or purpose == "compensate"
        return not bars and consists_of_curves(data.record)

    def fitted(self, data: TrainingData, options: Options) -> list[Trial]:
        """Held-out curves judge it. Raises `InputError` `too-few-curves`, and `not-increasing` where the
        output falls."""
        record, parts = data.record, data.parts
        if data.falls:
            raise InputError(
                "not-increasing",
                "the output falls as the input rises; a surface is made of rising curves.",
            )

        def model_of(which: tuple[int, ...]) -> Preisach:
            return everett_surface(_curves(replace(record, mask=np.isin(parts.label, which)))).model

        def error(model: Preisach, which: tuple[int, ...]) -> np.ndarray:
            rows = np.isin(parts.label, which)
            return record.weights[rows] * (predict(model, record)[rows] - record.output[rows])

        blocks = held_out_errors(parts.folds, model_of, error)
        model = model_of(parts.all)
        judged = evidence(record, parts, predict(model, record), float(blocks.mean()))
        assert model.reversible is not None
        assert isinstance(model.density, GridDensity)
        sums = {
            "offset": float(model.offset), "reversible.rise": float(np.sum(model.reversible)),
            "density.mass": float(np.sum(model.density.weights)),
        }  # fmt: skip
        unit, count = record.output_unit, len(_curves(record))
        note = f"Interpolated between {count} first-order reversal curves; nothing was smoothed."
        fit = FitResult(
            name=self.name,
            model=model,
            parameters=tuple(
                Parameter(name, value, unit, None, "inseparable") for name, value in sums.items()
            ),
            covariance=np.zeros((0, 0)),
            **judged._asdict(),
            success=True,
            blocks=blocks,
            notes=(note,),
            detail=ReversalCurves(count),
            **data.shown,
        )
        return [Trial(fit)]


def consists_of_curves(record: Record) -> bool:
    """Whether a record consists of first-order reversal curves of an output that rises."""
    try:
        curves = _curves(record)
    except InputError:
        return False
    rows = sum(len(curve.input) for curve in curves)
    return len(curves) >= FEWEST and rows > SHARE * int(record.mask.sum())


def _curves(record: Record) -> tuple[Forc, ...]:
    """One curve for each reversal."""
    curves = forc_curves(record)
    least = HELD * (curves[-1].reversal - curves[0].reversal) / len(curves)
    kept = list(curves[:1])
    for curve in curves[1:]:
        if curve.reversal > kept[-1].reversal + least:
            kept.append(curve)
    return tuple(kept)


COMPOSITION = "Composition"
"""Not a model but a search for one: curves, relays and relaxations, as many as the record shows."""

SURFACE = "EverettSurface"
"""A Preisach model read off first-order reversal curves."""

BUTTERFLY = "Butterfly"
"""A composition of a state that the output is an even curve of, or nearly."""

AUTO = ("Preisach", SURFACE, COMPOSITION, BUTTERFLY, "LinearSponge", "Burgers")
"""What `model="auto"` tries, what tells most in least time first: the last two take seconds to compile, and
are left out where they cannot be as good. A surface is tried only where a record consists of such curves, a
butterfly only where most branches have a valley or a peak."""

OSCILLATOR = "Oscillator"
"""A mass on a hysteretic spring, fitted by a search of its own and never beside models without a mass."""

ALSO = {"duhem": "DuhemOperator"}
"""Other names of models, unless a distribution announces a model of that name."""

SEARCHES: dict[str, type[Candidate]] = {
    SURFACE: SurfaceCandidate,
    COMPOSITION: CompositionCandidate,
    BUTTERFLY: ButterflyCandidate,
}
"""Names that are no models: ways to find one."""

PART, CURVE, WHOLE, INSIDE, CHANNEL, TRAINED = (
    "it is a part of a sum, and its thresholds, time constants or places are chosen with the other parts.",
    "it is a curve without memory, whose knots or degree nothing names.",
    "it is made of other models, and the name does not say which.",
    "it acts on a moving mass, and is fitted with it.",
    "it is what a channel between modes has beside a line, and is fitted by identify.fit_feedback.",
    "it is trained on records of a soft sensor (hysid microchannel train).",
)
"""Why a name alone cannot be fitted."""

INSTEAD = {
    **dict.fromkeys(
        ("ModulatedStops", "NonlinearMaxwell", "Softening", "VelocityFriction", "CyclicDrift", "TimeDrift"),
        (PART, COMPOSITION, ""),
    ),
    "Clip": (PART, COMPOSITION, ""),
    **dict.fromkeys(
        ("MonotoneCurve", "MonotoneSpline", "PolynomialCurve"),
        (CURVE, COMPOSITION, ", which begins with a rising curve"),
    ),
    **dict.fromkeys(("Sum", "Series", "Scaled", "Mixture"), (WHOLE, COMPOSITION, "")),
    "Conditioned": (WHOLE, COMPOSITION, ", and name the column of the condition"),
    "BoucWenForce": (INSIDE, "Oscillator(BoucWen)", ""),
    "DuhemForce": (INSIDE, "Oscillator(Duhem)", ""),
    "GeneralizedPlays": (INSIDE, "Oscillator(GeneralizedPlays)", ""),
    "StopsAndPowers": (CHANNEL, COMPOSITION, ""),
    **dict.fromkeys(("StaircaseNetwork", "BackwardsModel"), (TRAINED, COMPOSITION, "")),
}  # fmt: skip
"""Models of ours without a name in `fit`: why, what to fit instead, and what to add to it."""

Asked = str | AbstractModel | type[AbstractModel]
"""Names with or without commas between, a class, or a model to start from; "auto" is several."""


def candidates(model: Any) -> tuple[Candidate, ...]:
    """What `fit` is asked to fit: `Asked`, or several of them.

    Raises `InputError` `unknown-model` for a name without a model, `not-a-model` for anything else, and
    `no-start-values` for a class that says nowhere where a fit starts.
    """
    asked = [model] if isinstance(model, str | AbstractModel | type) else list(model)
    found: list[Candidate] = []
    for one in asked:
        for part in one.split(",") if isinstance(one, str) else [one]:
            found += _named(part.strip()) if isinstance(part, str) else [_given(part)]
    if not found:
        raise InputError("unknown-model", "no model is named.", fix="name one, or auto.")
    return tuple(_told_apart(found))


def names() -> tuple[str, ...]:
    """Every name that `fit` takes but auto, the candidates of auto first."""
    return (*AUTO, *(name for name in model_names() if name not in AUTO), *SHAPES, OSCILLATOR)


def _named(name: str) -> list[Candidate]:
    if name.casefold() == "auto":
        return [one for name in AUTO for one in _named(name)]
    for search, found in SEARCHES.items():
        if name.casefold() == search.casefold():
            return [found(search)]
    for shape in SHAPES:
        if name.casefold() == shape.casefold():
            return [ParametricCandidate(shape, Preisach, shape=shape)]
    known = find_model(name) or find_model(ALSO.get(name.casefold(), name))
    if known is None:
        meant = similar(name, names())
        raise InputError(
            "unknown-model",
            f"No model {name!r}; have {', '.join(names())}.",
            fix=f"did you mean {meant}?"
            if meant
            else "name one or several of them with commas between, or auto.",
        )
    if not known.can_start and known.name in INSTEAD and known.kind.__module__.startswith(OURS):
        cause, instead, added = INSTEAD[known.name]
        if cause != INSIDE:
            added += f". In Python a fit also starts from a model: identify.fit(record, {known.name}(...))"
        raise InputError(
            "no-start-values",
            f"a fit of {known.name} does not start from its name.",
            cause=cause,
            fix=f"fit {instead}{added}.",
        )
    if not (known.can_start or known.kind is Preisach):
        raise InputError(
            "no-start-values",
            f"nothing says where a fit of {known.name} starts.",
            cause="it was registered without a guess, and its fields have no defaults.",
            fix=f"give a {known.kind.__name__} to start from, or register it with a guess.",
        )
    return [_of_class(known.name, known.kind, None)]


def _given(one: Any) -> Candidate:
    template = one if isinstance(one, AbstractModel) else None
    kind = one if isinstance(one, type) else type(one)
    if not issubclass(kind, AbstractModel):
        raise InputError(
            "not-a-model",
            f"{one!r} is not a model, nor the name of one.",
            fix=f"give a name ({', '.join(names())}), a subclass of AbstractModel, or one of its models.",
        )
    known = registered(kind)
    if template is None and kind is not Preisach and (known is None or not known.can_start):
        raise InputError(
            "no-start-values",
            f"nothing says where a fit of {kind.__name__} starts.",
            cause="its class is not registered with a guess.",
            fix=f"give a {kind.__name__} to start from, or register({kind.__name__}, guess=...).",
        )
    return _of_class(kind.__name__ if known is None else known.name, kind, template)


def _of_class(name: str, kind: type[AbstractModel], template: AbstractModel | None) -> Candidate:
    density = getattr(template, "density", None)
    if kind is Preisach and (template is None or isinstance(density, GridDensity)):
        return GridCandidate(name, kind, template)
    return ParametricCandidate(name, kind, template)


def _told_apart(found: list[Candidate]) -> list[Candidate]:
    """Several of one name get numbers."""
    seen: dict[str, int] = {}
    different = []
    for one in dict.fromkeys(found) if all(c.template is None for c in found) else found:
        seen[one.name] = seen.get(one.name, 0) + 1
        count = seen[one.name]
        different.append(one if count == 1 else replace(one, name=f"{one.name} ({count})"))
    return different
