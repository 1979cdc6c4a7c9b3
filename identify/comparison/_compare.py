"""Which of several models of the same data predicts best, and whether the data can tell."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import scipy
from jaxtyping import Float
from scipy.special import ndtri

from hysteresis import InputError, Record
from hysteresis.records._loop_table import LoopTable

from .._levels import CHANCE, CONFIDENCE
from ..files._fit_folder import read_document, summary
from ..posterior._log_posterior import target, top_of
from ..records._folds import block_errors, root_difference
from ..results._fit_result import FitResult
from ..results._goodness_of_fit import Criteria
from ._change import holm
from ._gaussian_estimate import Fitted, opened

# How probable a fitted model makes the rows it was fitted to: criteria and evidence.


def criteria(rmse: float, numbers: int, rows: float) -> Criteria:
    """AIC = 2 k - 2 log L and BIC = k log n - 2 log L of Gaussian residuals at the likeliest sigma:

        log L = -n / 2 (log(2 pi rmse^2) + 1),      k = numbers + 1, sigma being the last.

    `rows`: n, as many as are worth one each where residuals are coloured.

    Source: Burnham, Anderson, Model Selection and Multimodel Inference (2002), chapters 2 and 6.
    """
    twice = -rows * (np.log(2 * np.pi * rmse**2) + 1)
    k = numbers + 1
    return Criteria(float(2 * k - twice), float(k * np.log(rows) - twice))


def log_evidence(fit: FitResult) -> float | None:
    """log of the probability of the counted rows under the model and its priors, by Laplace's method:

        log integral p(y | z) p(z) dz  =  log p(y, z0) + d / 2 log 2 pi + log |C| / 2,

    z0 the likeliest point, C the covariance there, d numbers, those of the noise among them. None for a fit
    without a noise model, whose likelihood counts rows for less and so is not one of the rows.

    Source: Tierney, Kadane, J. American Statistical Association 81 (1986).
    """
    if fit.noise_model is None:
        return None
    about = target(fit)
    top = top_of(about)
    log_root = np.linalg.slogdet(np.asarray(top.root))[1]
    return float(top.height + len(about.names) / 2 * np.log(2 * np.pi) + log_root)


class Compared(NamedTuple):
    """A model with the figures it is compared by; None where one is not to be had.

    - `held_out`, `test`: NRMSE in per cent on held-out blocks of the training part, and on the test record.
    - `numbers`: how many were fitted, the noise's not counted; None for weights held together by a prior,
      which AIC and BIC do not count either.
    - `aic`, `bic`, `log_evidence`: see `compare`.
    - `blocks`, `test_blocks`: mean squared errors of blocks of consecutive rows, in squares of a per cent.
    """

    name: str
    model: str
    held_out: float | None
    test: float | None
    numbers: int | None
    aic: float | None = None
    bic: float | None = None
    log_evidence: float | None = None
    blocks: Float[np.ndarray, " blocks"] | None = None
    test_blocks: Float[np.ndarray, " blocks"] | None = None


class Difference(NamedTuple):
    """By how much the error of one model is less than another's, in per cent of the range, and the standard
    error of that, paired over `blocks`."""

    value: float
    error: float
    blocks: int

    @property
    def clear(self) -> bool:
        """Whether it is beyond chance: Student's t at 95 %."""
        return abs(self.value) > float(scipy.special.stdtrit(self.blocks - 1, 0.975)) * self.error


class Pair(NamedTuple):
    """One model against another: `held_out` and `test` are positive where `one` predicts better."""

    one: str
    other: str
    held_out: Difference | None
    test: Difference | None

    @property
    def words(self) -> tuple[str, ...]:
        """What can be said of the two, in sentences."""
        known = {"held-out": self.held_out, "test": self.test}
        said = tuple(self._sentence(rows, d) for rows, d in known.items() if d is not None)
        return said or (f"{self.one} and {self.other}: no blocks to pair.",)

    def _sentence(self, rows: str, found: Difference) -> str:
        if not found.clear:
            size = f"{found.value:+.2g} ± {found.error:.1g} %"
            return f"{self.one} and {self.other} cannot be told apart on {rows} rows ({size})."
        first, second = (self.one, self.other) if found.value > 0 else (self.other, self.one)
        size = f"{abs(found.value):.2g} ± {found.error:.1g} %"
        return f"{first} predicts {rows} rows better than {second} by {size} of the range."


@dataclass(frozen=True)
class Comparison:
    """Models ranked by how well they predict rows they were not fitted to, best first.

    - `ranked_on`: "held-out" blocks of the training part, or the "test" record.
    - `notes`: warnings, in sentences.
    """

    models: tuple[Compared, ...]
    ranked_on: str
    notes: tuple[str, ...]

    @property
    def best(self) -> str:
        """Name of the first."""
        return self.models[0].name

    @property
    def pairs(self) -> tuple[Pair, ...]:
        """The best against every other."""
        return tuple(self.pair(self.best, other.name) for other in self.models[1:])

    def pair(self, one: str, other: str) -> Pair:
        """Any two; the other way round all signs change."""
        known = {model.name: model for model in self.models}
        a, b = known[one], known[other]
        held_out, test = _paired(a.blocks, b.blocks), _paired(a.test_blocks, b.test_blocks)
        return Pair(one, other, held_out, test)

    @property
    def words(self) -> tuple[str, ...]:
        """What was found, in sentences."""
        return (*(said for pair in self.pairs for said in pair.words), *self.notes)


def compare(fits: Mapping[str, Fitted] | Sequence[Fitted]) -> Comparison:
    """Rank fits of the same data by their error on rows that were held out from them.

    What counts is the error on blocks of consecutive rows, never on random rows, which their neighbours
    would tell. A difference is paired over the blocks: with e_k the mean squared error of block k in
    squares of the output's range and m its mean,

        difference = 100 (sqrt m_B - sqrt m_A),
        error      = 100 sd_k(e_k,B / (2 sqrt m_B) - e_k,A / (2 sqrt m_A)) / sqrt(blocks).

    Beside it, where the fits count the same training rows, and as far as they can be had:

    - `criteria`, with one number of rows for all: rows / correlation time of the best model's residuals.
    - `log_evidence`, of parametric fits with a noise model; a statement about their priors too.

    **Arguments:**

    - `fits`: fits or their folders, by name or in a row; of either orientation, of one output.

    Raises `InputError` `not-comparable` for fits of other data or of another output, and for fits that held
    out other rows and share no test record.

    In the example: a Preisach model predicts held-out rows better than a line.

    **Example:**

        >>> comparison = identify.compare({"line": fit, "relays": grid_fit})
        >>> comparison.best, comparison.ranked_on, comparison.pair("relays", "line").held_out.clear
        ('relays', 'held-out', True)
    """
    named = fits if isinstance(fits, Mapping) else dict(zip(_names(fits), fits, strict=True))
    loaded, _ = opened([*named.values()], [None] * len(named))
    by_name = dict(zip(named, loaded, strict=True))
    _check_same_data(by_name)
    same_train = _alike([_counted(fit.train, fit.train.mask) for fit in loaded])
    tests = [fit.test and _counted(fit.test, fit.test.mask) for fit in loaded]
    same_test = None not in tests and _alike(tests)
    models = [compared(name, summary(fit)) for name, fit in by_name.items()]
    notes = []
    if same_test:
        pairs = zip(models, loaded, strict=True)
        models = [model._replace(test_blocks=_test_blocks(fit)) for model, fit in pairs]
    if not same_train:
        notes.append("They held out other training rows, so only the test record compares them.")
        models = [model._replace(held_out=None, blocks=None) for model in models]
    models, ranked_on = _ranked(models, same_test)
    if not _alike([_counted(fit.train, fit.used) for fit in loaded]):
        notes.append("Fitted to other training rows: criteria and evidence say nothing.")
        return Comparison(tuple(models), ranked_on, tuple(notes))
    models = with_criteria(models, {name: summary(fit) for name, fit in by_name.items()})
    models = [one._replace(log_evidence=log_evidence(by_name[one.name])) for one in models]
    if sum(model.log_evidence is not None for model in models) > 1:
        notes.append("The evidence weighs the priors too: with wider ones it is less.")
    return Comparison(tuple(models), ranked_on, tuple(notes))


def compare_candidates(folder: str | Path) -> Comparison:
    """The candidates of one fit, from the figures that its folder keeps.

    Raises `InputError` `too-few-fits` if the fit tried one model alone, and if nothing was held
    out, as in creep.

    In the example: a fit that tried two models.
    """
    document = read_document(folder)
    tried = {candidate["model"]: candidate for candidate in document["candidates"]}
    if len(tried) < 2:
        raise InputError(
            "too-few-fits",
            "one model was tried here, so there is nothing to compare it with.",
            place=str(folder),
            fix="name a second folder, or fit several models (--model NAME,NAME).",
        )
    models = [compared(name, candidate) for name, candidate in tried.items()]
    notes = [
        "Of candidates the figures alone are kept: no test rows paired, no evidence, no posterior."
    ]
    if all(model.blocks is None for model in models):
        notes.append("Held-out blocks were not kept: fit again for standard errors.")
    models, ranked_on = _ranked(models, all(model.test is not None for model in models))
    if _alike([candidate["noise"]["samples"] for candidate in tried.values()]):
        models = with_criteria(models, tried)
    return Comparison(tuple(models), ranked_on, tuple(notes))


def compared(name: str, figures: dict[str, Any]) -> Compared:
    """A model with what `summary` says of it."""
    test, blocks, score = (
        figures["metrics"]["test"],
        figures.get("blocks"),
        figures["score_percent"],
    )
    if blocks is not None:
        squares = np.array(blocks)
        blocks = squares * (score**2 / (squares.mean() or 1.0))
    return Compared(
        name,
        figures["model"],
        score if blocks is not None else None,
        None if test is None else test["nrmse_percent"],
        figures.get("numbers"),
        blocks=blocks,
    )


def with_criteria(
    models: Sequence[Compared], figures: Mapping[str, dict[str, Any]]
) -> list[Compared]:
    """AIC and BIC of each, with the rows that the first one's residuals are worth."""
    first = figures[models[0].name]["noise"]
    rows = first["samples"] / first["correlation_time"]
    found = []
    for model in models:
        rmse = figures[model.name]["metrics"]["train"]["rmse"]
        if model.numbers is not None and rmse > 0:
            model = model._replace(**criteria(rmse, model.numbers, rows)._asdict())
        found.append(model)
    return found


def _ranked(models: list[Compared], same_test: bool) -> tuple[list[Compared], str]:
    """Best first, by held-out blocks where every model has them, else by the test record."""
    lengths = {None if model.blocks is None else len(model.blocks) for model in models}
    if len(lengths) == 1 and None not in lengths:
        return sorted(models, key=lambda model: model.held_out or 0.0), "held-out"
    if same_test:
        return sorted(models, key=lambda model: model.test or 0.0), "test"
    raise InputError(
        "not-comparable",
        "the fits were held out from in different ways, or not at all, and share no test record.",
        cause="one left first cycles out or had a test part that another did not.",
        fix="fit with the same --test-cycles, --test-tail or --test-where.",
    )


def _paired(one: np.ndarray | None, other: np.ndarray | None) -> Difference | None:
    """Of the roots of two means of paired blocks; its error to first order."""
    if one is None or other is None or (found := root_difference(one, other)) is None:
        return None
    return Difference(*found, len(one))


def _test_blocks(fit: FitResult) -> np.ndarray:
    """Squared errors on the test record, which is kept as the model saw it, in ten blocks."""
    record = fit.test
    assert record is not None
    error = (record.weights * (fit.predict(record) - record.output))[record.mask]
    span = float(np.ptp(record.output[record.mask])) or 1.0
    return 1e4 * np.array(block_errors(error)) / span**2


def _counted(record: Record, rows: np.ndarray) -> tuple[str, bytes]:
    """Which measurements these rows of a record are, by a checksum of its file, or of the output."""
    checksum = record.sha256 or hashlib.sha256(record.output.tobytes()).hexdigest()
    return checksum, record.line[rows].tobytes()


def _alike(items: Sequence[Any]) -> bool:
    return all(item == items[0] for item in items)


def _check_same_data(fits: Mapping[str, FitResult]) -> None:
    """Raise `InputError` where two fits are of other files, other rows of a file, or other outputs."""
    (first, fit), *others = fits.items()
    for name, other in others:
        one, two = fit.train, other.train
        if (one.output_name, one.output_unit) != (two.output_name, two.output_unit):
            what = f"{first} predicts {one.output_name}, {name} {two.output_name}"
        elif _counted(one, one.line > 0) != _counted(two, two.line > 0):
            said = [f"{(r.line > 0).sum()} rows of {r.source or 'arrays'}" for r in (one, two)]
            what = f"{first} was fitted to {said[0]}, {name} to {said[1]}"
        else:
            continue
        raise InputError(
            "not-comparable",
            f"{what}: their errors do not compare.",
            fix="fit both to the same rows; of one model on different data, see what changed (--change).",
        )


def _names(fits: Sequence[Fitted]) -> list[str]:
    """Folders by their names, fits by their models', numbered where two are alike."""
    plain = [fit.name if isinstance(fit, FitResult) else Path(fit).name for fit in fits]
    if len(set(plain)) < len(plain):
        plain = [f.name if isinstance(f, FitResult) else str(f) for f in fits]
    return [f"{n} ({k})" if plain.count(n) > 1 else n for k, n in enumerate(plain, 1)]


# Which figures of their loops two groups of specimens differ in, and how many specimens would tell.

FEW = "fewer than two specimens of a group tell it"


class LoopDifference(NamedTuple):
    """A figure in two groups: their means over specimens, the second less the first, and its error.

    - `p`: the probability of a difference this large if there was none (Welch), corrected for the number of
      figures (Holm). `needed`: specimens a group that would show this difference in 90 of 100 cases at the
      same level without correction; None without a difference. `reason`: why nothing is told.
    """

    name: str
    unit: str
    one: float | None
    other: float | None
    difference: float | None
    error: float | None
    p: float | None
    needed: int | None
    reason: str = ""

    @property
    def clear(self) -> bool:
        """Whether the difference is statistically significant."""
        return self.p is not None and self.p < CHANCE


def compare_loops(
    one: Sequence[LoopTable], other: Sequence[LoopTable]
) -> tuple[LoopDifference, ...]:
    """The figures of two groups of specimens; each specimen counts once, by its mean over the full loops.

    **Arguments:**

    - `one`, `other`: a table for each specimen, of one kind.

    **Raises:** `InputError` `too-few-fits` where a group is empty, `wrong-unit` where units differ.

    **Example:**

        >>> tables = [fit.loops() for fit in specimens]
        >>> found = identify.compare_loops(tables[:2], tables[1:])
        >>> found[0].name, found[0].clear
        ('duration', False)
    """
    if not (one and other):
        raise InputError(
            "too-few-fits", "A group has no specimen.", fix="Give one or more of each."
        )
    told = [[{s.name: s for s in table.summary} for table in group] for group in (one, other)]
    found = []
    for name in (n for n in one[0].names if all(n in s for group in told for s in group)):
        x, y = (
            np.array([s[name].value for s in group if s[name].value is not None], float)
            for group in told
        )
        unit, *others = sorted({s[name].unit for group in told for s in group})
        if others:
            raise InputError(
                "wrong-unit", f"{name} is in {unit} and in {others[0]}.",
                fix="Give both groups in the same units.",
            )  # fmt: skip
        if min(len(x), len(y)) < 2:
            found.append(LoopDifference(name, unit, None, None, None, None, None, None, FEW))
            continue
        squares = np.array([np.var(z, ddof=1) for z in (x, y)])
        difference, error = float(y.mean() - x.mean()), np.sqrt(squares @ [1 / len(x), 1 / len(y)])
        p, needed = 1.0, None
        if difference:
            welch = (
                scipy.stats.ttest_ind_from_stats
            )  # of figures: readings that agree give no warning
            sizes = (part for z in (x, y) for part in (z.mean(), z.std(ddof=1), len(z)))
            p = float(welch(*sizes, equal_var=False).pvalue) if error else 0.0
            each = squares.sum() / difference**2
            needed = max(2, int(np.ceil(each * (ndtri(1 - CHANCE / 2) + ndtri(CONFIDENCE)) ** 2)))
        means = float(x.mean()), float(y.mean())
        found.append(LoopDifference(name, unit, *means, difference, float(error), p, needed))
    tested = [k for k, row in enumerate(found) if row.p is not None]
    corrected = holm(np.array([found[k].p for k in tested], float)) if tested else []
    for k, p in zip(tested, corrected, strict=True):
        found[k] = found[k]._replace(p=float(p))
    return tuple(found)
