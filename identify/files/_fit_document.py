"""What fit.json holds, as types: a document that is otherwise is refused where it is read."""

from typing import Any, Literal, NotRequired, TypedDict

from hysteresis._serialisation import decoded
from hysteresis._verdict import Level

from ..noise._residual_statistics import Noise
from ..parameters._settings import SettingWords
from ..records._clocks import Clocks
from ..records._sequence_terms import SequenceTerms
from ..results._fit_result import Parameter
from ..results._goodness_of_fit import Metrics
from ..results._trained_condition import Extrapolation


class Errors(TypedDict):
    """Errors on both records."""

    train: Metrics | None
    test: Metrics | None


class ReasonWords(TypedDict):
    """A note with its code."""

    code: str
    text: str
    values: NotRequired[dict[str, Any] | None]


class VerdictWords(TypedDict):
    """A `Verdict`; earlier versions wrote sentences alone."""

    level: Level
    reasons: list[str | ReasonWords]
    best_baseline: NotRequired[str | None]


class BaselineWords(TypedDict):
    """A `Baseline`."""

    name: str
    score_percent: float
    metrics: Errors
    blocks: list[float]
    test_blocks: list[float] | None


class FigureWords(TypedDict):
    """The figures that a fit and its candidates have."""

    model: str
    parameters: tuple[Parameter, ...]
    metrics: Errors
    success: bool
    trusted: NotRequired[bool]
    score_percent: float
    noise: Noise
    notes: tuple[str, ...]
    verdict: VerdictWords
    seconds: float
    blocks: NotRequired[list[float] | None]
    test_blocks: NotRequired[list[float] | None]
    noise_model: NotRequired[dict[str, float | str] | None]
    noise_evidence: NotRequired[dict[str, float]]
    numbers: NotRequired[int | None]


class RecordWords(TypedDict):
    """A record without its arrays; earlier versions wrote sentences without codes."""

    input_name: str
    input_unit: str
    output_name: str
    output_unit: str
    time_name: str
    time_unit: str
    labels: tuple[str, ...]
    source: str
    sha256: str
    history: list[str | tuple[str, str]]
    conditions: NotRequired[dict[str, str]]
    sigma_name: NotRequired[str]


class DataWords(TypedDict):
    """What was fitted."""

    source: str
    sha256: str
    date: NotRequired[str | None]
    rows: int
    rows_train: int
    rows_test: int
    sequences: int
    input: dict[Literal["name", "unit"], str]
    output: dict[Literal["name", "unit"], str]
    time_unit: str
    history: list[str]


class SimpleWords(TypedDict):
    """The error of a baseline that compensates."""

    name: str
    rmse: float
    max_abs: float
    nrmse_percent: float


class MotionWords(TypedDict):
    """The motions that a band was learnt from."""

    inputs: list[float]
    turns: list[list[list[float]]]
    speeds: list[float]
    ends: list[float]
    growth: list[float]


class BandWords(TypedDict):
    """The error of a compensator, without the compensator."""

    levels: list[float]
    error: list[list[float]]
    scores: list[float]
    width: float
    coverage: float
    coverage_before: float
    share: NotRequired[float]
    lasts: NotRequired[float]
    motions: MotionWords | None


class CompensatorWords(TypedDict, total=False):
    """The compensator of a fit, judged."""

    rows: str
    rmse: float
    max_abs: float
    nrmse_percent: float
    baselines: list[SimpleWords]
    better: list[str]
    refused: str | None
    band: BandWords
    band_of: str
    ok_share: float
    ok_after: dict[Literal["cycles", "time"], float | None]
    start: str


class ResultWords(FigureWords):
    """One fit, without its model."""

    candidates: list[FigureWords]
    baselines: NotRequired[list[BaselineWords]]
    extrapolation: NotRequired[Extrapolation | None]
    compensator: NotRequired[CompensatorWords | None]
    purpose: NotRequired[Literal["predict", "compensate", "constants"]]
    skipped: dict[str, str]
    clocks: NotRequired[Clocks]
    sequences: NotRequired[SequenceTerms | None]
    settings: NotRequired[dict[str, SettingWords]]
    seed: int
    data: DataWords
    versions: NotRequired[dict[str, str]]


class FitWords(ResultWords):
    """fit.json of one fit."""

    records: dict[Literal["train", "test"], RecordWords]
    structure: dict[str, Any]
    files: dict[str, str]


class SeveralWords(TypedDict, total=False):
    """fit.json of several fits, each in a folder below: their means, all of them, and those that failed."""

    model: str
    metrics: Errors
    verdict: VerdictWords
    data: DataWords
    each: dict[str, dict[str, Any]]
    folders: dict[str, str]
    failed: dict[str, str]


def checked(document: dict[str, Any]) -> dict[str, Any]:
    """The entries of fit.json as their types say. Raises `ValueError` and `TypeError`."""
    several = "folders" in document or "each" in document
    return decoded(document, SeveralWords if several else FitWords)
