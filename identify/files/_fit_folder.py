"""A fit in a folder: JSON and plain arrays, nothing that can run.

fit.json     for people and scripts: model, parameters, metrics, candidates, verdict, data
model.npz    arrays of the model      data.npz   the training and the test record
fit.npz      residuals, starts, and the normal equations of a grid fit
"""

import hashlib
import os
import time
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any, Literal, NotRequired, TypedDict

import numpy as np

from hysteresis import InputError, Note, Record
from hysteresis._format import plain
from hysteresis._limits import damage_told, load_arrays
from hysteresis._serialisation import decoded, described, rebuilt
from hysteresis._verdict import Level, Verdict

from .._levels import HELD_AT_ONCE, TRIES
from ..noise._model import NoiseModel
from ..noise._reml import PARTS
from ..noise._residual_statistics import Noise
from ..parameters._settings import SettingWords, from_words, in_words
from ..records._clocks import Clocks
from ..records._sequence_terms import SequenceTerms
from ..results._detail import detail_of
from ..results._fit_result import Candidate, FitResult, Parameter, Starts
from ..results._goodness_of_fit import Baseline, Metrics
from ..results._trained_condition import Extrapolation
from ..storage._file_set import check_free, read_checked, versions, whole_files, write_set

# What fit.json holds, as types: a document that is otherwise is refused where it is read.


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


SCHEMA = 1
MAY_PASS = "", "wrong-checksum", "file-not-found"
"""Faults of a folder that another process may be writing: it is looked at again."""
OF_EARLIER = (
    "posterior.json", "posterior.nc", "posterior_models.npz", "chains.npz",
    "report.html",
)  # fmt: skip
"""What belongs to an earlier fit in the same folder."""
_RECORD_ARRAYS = ("input", "output", "time", "starts", "mask", "line")


def save(
    fit: FitResult,
    folder: str | Path,
    *,
    overwrite: bool = False,
    extra: dict[str, Any] | None = None,
) -> Path:
    """Write a fit to a folder of JSON and plain arrays.

    **Arguments:**

    - `folder`: is made if it is not there. A posterior or report of an earlier fit in it is removed.
    - `overwrite`: write although the folder holds results.
    - `extra`: plain data that is added to fit.json.

    Returns the folder.

    Raises `InputError` if results are there already, the folder cannot be written, or the model is of a
    class that is not registered (`hysteresis.register`), so that the folder could not be loaded.

    **Example:**

        >>> place = identify.save(fit, folder / "sponge")
        >>> sorted(file.name for file in place.iterdir())
        ['data.npz', 'fit.json', 'fit.npz', 'model.npz']
    """
    folder = Path(folder)
    write_fit(fit, folder, to_json(fit), overwrite=overwrite, extra=extra)
    return folder


def write_fit(
    fit: FitResult,
    folder: Path,
    words: dict[str, Any],
    *,
    overwrite: bool = False,
    extra: dict[str, Any] | None = None,
) -> dict[str, Any]:
    """`save`, from what `to_json` gave; returns what fit.json holds, so that nobody has to read it back."""
    check_free(folder, overwrite)
    structure, arrays = described(fit.model)
    channels: dict[str, Any] = {}
    if fit.channels is not None:
        curves, _ = described(fit.channels, "channels", arrays)
        channels["channels"] = curves | {"names": fit.channels.names, "units": fit.channels.units}
    records = {"train": fit.train, **({} if fit.test is None else {"test": fit.test})}
    data = {
        f"{part}_{name}": value
        for part, record in records.items()
        for name, value in _record_arrays(record).items()
    }
    of_records = {part: _record_words(record) for part, record in records.items()}
    document = words | channels | {"structure": structure, "records": of_records}
    files = {"model.npz": arrays, "data.npz": data, "fit.npz": _fit_arrays(fit)}
    check = partial(check_free, folder, overwrite)
    document |= fit.detail.words() | (extra or {})
    return write_set(folder, "fit.json", document, files, remove=OF_EARLIER, check=check)


def load(folder: str | Path) -> FitResult:
    """Read a fit from the folder that `save` wrote.

    The models that the fit tried come back as `Candidate`: their figures, without model and residuals.
    Nothing in the folder is executed.

    Raises `InputError` for a missing or damaged file, a changed checksum, a newer schema, and a model that
    is not registered.

    **Example:**

        >>> place = identify.save(fit, folder / "sponge")
        >>> again = identify.load(place)
        >>> again.name, [candidate.verdict.level for candidate in again.candidates]
        ('LinearSponge', ['CAUTION'])
    """
    return read_fit(Path(folder))[0]


def read_fit(folder: Path) -> tuple[FitResult, dict[str, Any]]:
    """`load`, and the document of the fit: fit.json is read once."""
    for again in range(TRIES):
        try:
            document = read_document(folder)
            files = {} if "files" not in document else whole_files(folder, document)
            break
        except (InputError, FileNotFoundError) as error:
            # Another process may be writing the folder: its next look is at one whole set.
            if again == TRIES - 1 or getattr(error, "code", "") not in MAY_PASS:
                raise
            time.sleep(0.05)
    if several := [*document.get("folders", {}).values()] or [*document.get("each", ())]:
        said = f"here are {len(several)} fits, one in each folder below."
        fix = f"name one of them: {', '.join(several[:5])}."
        raise InputError("several-fits", said, place=str(folder), fix=fix)
    with damage_told("fit.json, or one of its arrays,", folder, "fit again."):
        return _load(checked(document), files), document


def _load(document: dict[str, Any], files: dict[str, Path]) -> FitResult:
    data, extra = (load_arrays(files[name]) for name in ("data.npz", "fit.npz"))
    records = {part: _record(part, words, data) for part, words in document["records"].items()}
    arrays = load_arrays(files["model.npz"])
    model = rebuilt(document["structure"], arrays)
    starts = {k: extra[f"starts_{k}"] for k in Starts._fields if f"starts_{k}" in extra}
    return FitResult(
        **_figures(document),
        model=model,
        covariance=extra["covariance"],
        residuals=extra["residuals"],
        settings=from_words(document.get("settings", {})),
        train=records["train"],
        test=records.get("test"),
        starts=Starts(**starts) if starts else None,
        used=extra["used"],
        detail=detail_of(document, extra, model),
        candidates=tuple(
            Candidate(**_figures(candidate), parameter_count=candidate.get("numbers"))
            for candidate in document["candidates"]
        ),
        baselines=tuple(map(Baseline.of, document.get("baselines", ()))),
        extrapolation=document.get("extrapolation"),
        compensator=document.get("compensator"),
        purpose=document.get("purpose", "predict"),
        skipped=document["skipped"],
        clocks=document.get("clocks", Clocks()),
        channels=rebuilt(document["channels"], arrays) if "channels" in document else None,
        sequences=document.get("sequences"),
        asked={name: document[name] for name in ("selection", "options") if name in document},
        seed=document["seed"],
    )


def _figures(saved: dict[str, Any]) -> dict[str, Any]:
    """The inverse of `summary`: the fields that `FitResult` and `Candidate` share."""
    blocks = {k: saved.get(k) for k in ("blocks", "test_blocks")}
    same, noise = ("parameters", "metrics", "success", "noise", "notes", "seconds"), None
    if (words := saved.get("noise_model")) is not None:
        noise = NoiseModel(**{name: words[name] for name in PARTS if name in words})
    return {name: saved[name] for name in same} | {
        "name": saved["model"],
        "score": saved["score_percent"],
        **{k: None if x is None else np.array(x) for k, x in blocks.items()},
        "noise_model": noise,
        "noise_evidence": saved.get("noise_evidence", {}),
        "verdict": Verdict.of(saved["verdict"]),
    }


def read_document(folder: str | Path) -> dict[str, Any]:
    """fit.json of a folder. Raises `InputError` where it is not one of ours, or of a newer kind."""
    folder, make = Path(folder), "make one: hysid fit --out DIR."
    document = read_checked(folder, "fit.json", SCHEMA, make=make, again="fit again.")
    with damage_told("fit.json", folder, "fit again."):
        checked(document)
    return document


def _date_of(record: Record) -> str | None:
    """The day, ISO 8601, on which the record's file was written; None where that file is not at hand."""
    if not record.sha256:
        return None
    try:
        with Path(record.source).open("rb") as file:
            if hashlib.file_digest(file, "sha256").hexdigest() != record.sha256:
                return None
            return datetime.fromtimestamp(os.fstat(file.fileno()).st_mtime, UTC).date().isoformat()
    except OSError:
        return None


def to_json(fit: FitResult) -> dict[str, Any]:
    """What fit.json says about a fit, as plain data."""
    record = fit.train
    condition = fit.condition
    document = summary(fit) | {
        **({} if condition is None else {"condition": condition._asdict()}),
        "schema": SCHEMA,
        "candidates": [summary(candidate) for candidate in fit.candidates],
        "baselines": [baseline.document for baseline in fit.baselines],
        "extrapolation": None if fit.extrapolation is None else fit.extrapolation.document,
        **({} if fit.compensator is None else {"compensator": fit.compensator}),
        "purpose": fit.purpose,
        "detail": {"kind": fit.detail.kind},
        "characteristics": [one._asdict() for one in fit.characteristics],
        "determined": [p.name for p in fit.determined],
        "skipped": fit.skipped,
        "data": {
            "source": record.source,
            "sha256": record.sha256 or record.digest(),
            "date": _date_of(record),
            "rows": int((record.line > 0).sum()),  # a step's own row has no line
            "rows_train": int(record.mask.sum()),
            "rows_test": 0 if fit.test is None else int(fit.test.mask.sum()),
            "sequences": len(record.labels),
            "input": {"name": record.input_name, "unit": record.input_unit},
            "output": {"name": record.output_name, "unit": record.output_unit},
            "time_unit": record.time_unit,
            "history": list(record.history),
        },
        "clocks": fit.clocks._asdict(),
        "sequences": None if fit.sequences is None else fit.sequences._asdict(),
        "settings": in_words(fit.settings),
        **fit.asked,
        "seed": fit.seed,
        "versions": versions(),
    }
    return plain(document)


def summary(fit: FitResult | Candidate) -> dict[str, Any]:
    """The part of a fit that its candidates have too."""
    return {
        "model": fit.name,
        "parameters": [p._asdict() for p in fit.parameters],
        "metrics": {k: None if m is None else m._asdict() for k, m in fit.metrics.items()},
        "score_percent": fit.score,
        "blocks": fit.blocks,
        "test_blocks": fit.test_blocks,
        "numbers": fit.parameter_count,
        "success": fit.success,
        "trusted": fit.trusted,
        "noise": fit.noise._asdict(),
        "noise_model": _noise_words(fit.noise_model),
        "noise_evidence": fit.noise_evidence,
        "notes": list(fit.notes),
        "verdict": fit.verdict.document,
        "seconds": round(fit.seconds, 3),
    }


def residuals_of_all(folder: Path) -> tuple[np.ndarray | None, np.ndarray | None]:
    """Predicted - measured on the training record, (candidates, samples) and (baselines, samples).

    NaN where not counted. None for a fit that was saved without them: they are too many, or it was loaded.
    """
    arrays = load_arrays(folder / "fit.npz")
    return arrays.get("candidate_residuals"), arrays.get("baseline_residuals")


def _fit_arrays(fit: FitResult) -> dict[str, Any]:
    arrays = {name: getattr(fit, name) for name in ("residuals", "covariance", "used")}
    for name, tried in (
        ("candidate_residuals", [c.residuals for c in fit.candidates if isinstance(c, FitResult)]),
        ("baseline_residuals", [b.residuals for b in fit.baselines if b.residuals is not None]),
    ):
        count = len(tried) * len(fit.residuals)
        if {len(one) for one in tried} == {len(fit.residuals)} and count <= HELD_AT_ONCE:
            arrays[name] = np.array(tried, np.float32)
    if fit.starts is not None:
        arrays |= {f"starts_{k}": v for k, v in fit.starts._asdict().items()}
    return arrays | fit.detail.arrays()


def _noise_words(noise: NoiseModel | None) -> dict[str, Any] | None:
    if noise is None:
        return None
    parts = {name: getattr(noise, name) for name in PARTS}
    return {"kind": noise.words} | {n: float(v) for n, v in parts.items() if v is not None}


def _record_words(record: Record) -> dict[str, Any]:
    names = [f"{role}_{what}" for role in ("input", "output", "time") for what in ("name", "unit")]
    words = {n: getattr(record, n) for n in (*names, "labels", "source", "sha256")}
    if record.conditions:
        words["conditions"] = dict(record.conditions)
    if record.sigma_name:
        words["sigma_name"] = record.sigma_name
    return words | {"history": [(note.code, note.text) for note in record.history]}


def _record_arrays(record: Record) -> dict[str, np.ndarray]:
    arrays = {name: getattr(record, name) for name in _RECORD_ARRAYS}
    held = {f"condition_{k}": record.columns[name] for k, name in enumerate(record.conditions)}
    if record.sigma is not None:
        held["sigma"] = record.sigma
    return {name: x for name, x in (arrays | held).items() if x is not None}


def _record(part: str, words: dict[str, Any], data: dict[str, np.ndarray]) -> Record:
    """The inverse of `_record_words` and `_record_arrays`."""
    arrays: Any = {name: data.get(f"{part}_{name}") for name in _RECORD_ARRAYS}
    conditions = enumerate(words.get("conditions", {}))
    columns = {name: data[f"{part}_condition_{k}"] for k, name in conditions}
    if name := words.get("sigma_name"):
        columns[name] = data[f"{part}_sigma"]
    # Files of earlier versions hold sentences without codes.
    history = tuple(Note.of(x) if isinstance(x, str) else Note(*x) for x in words["history"])
    return Record(**arrays, **words | {"history": history}, columns=columns)
