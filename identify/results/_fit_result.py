"""What a fit gives back."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from numpy.typing import ArrayLike

from hysteresis import AbstractModel, ChannelMap, InputError, Record
from hysteresis._drawing import html_of, plot_of
from hysteresis._format import quantity
from hysteresis._precision import in_own_precision
from hysteresis._quantities import Units, with_units
from hysteresis._show import aligned, at_most
from hysteresis._verdict import Verdict
from hysteresis.records._csv import with_known
from hysteresis.records._loop_table import LoopTable

from .._levels import SEAM
from ..noise._model import NoiseModel
from ..noise._residual_statistics import Noise
from ..parameters._settings import Settings
from ..records._clocks import Clocks
from ..records._new_record import as_condition, beyond, combine, going_on, new_record, predict
from ..records._sequence_terms import SequenceTerms
from ._characteristics import Characteristic, characteristics, fitted_loops
from ._detail import Composition, Detail, Motion, Parametric
from ._goodness_of_fit import Baseline, Criteria, Metrics, criteria_of
from ._parameters import Parameter as Parameter
from ._parameters import Status as Status
from ._parameters import correlated, named
from ._trained_condition import Extrapolation, TrainedCondition, told, trained_condition
from ._trained_condition import check_units as check_units

PURPOSES = ("predict", "compensate", "constants")
"""What a fit may be for, and its verdict with it."""


class Starts(NamedTuple):
    """What became of every start: objective (mean squared error) and distance to the best, in z."""

    objective: Float[np.ndarray, " starts"]
    distance: Float[np.ndarray, " starts"]
    free: Float[np.ndarray, "starts parameters"]


@dataclass(frozen=True)
class Candidate:
    """The figures of a model that a fit tried, as they are saved with the fit; see `FitResult`.

    Its model and residuals are not saved. `parameter_count`: how many parameters were fitted, or None.
    """

    name: str
    parameters: tuple[Parameter, ...]
    metrics: dict[str, Metrics | None]
    success: bool
    score: float
    noise: Noise
    notes: tuple[str, ...]
    blocks: Float[np.ndarray, " blocks"] | None
    noise_model: NoiseModel | None
    noise_evidence: dict[str, float]
    verdict: Verdict
    seconds: float
    parameter_count: int | None
    test_blocks: Float[np.ndarray, " test_blocks"] | None = None

    @property
    def trusted(self) -> bool:
        """Whether the answer can be used: the verdict is not FAIL and the solver converged."""
        return self.success and self.verdict.level != "FAIL"


@dataclass(frozen=True)
class FitResult:
    """A model fitted to a record, with everything needed to judge it.

    - `name`, `model`: the model's name, and a new model of that type. It carries the units of the record,
      `model.units`, and the range of the inputs of the fit, `model.trained`.
    - `parameters`, `covariance` (of the free ones, in their order).
    - `residuals`: predicted - measured on the training record, (samples,); NaN where not counted.
    - `metrics`: {"train": Metrics, "test": Metrics or None}.
    - `success`: the solver converged. `trusted`: the answer can be used; `verdict` says why not.
    - `score`: held-out NRMSE (%) inside the training part, by which candidates are ranked.
    - `blocks`: mean squared errors of the held-out parts, in blocks of consecutive rows; `test_blocks`:
      of the test rows.
    - `baselines`: simple predictors on the same rows, see `Baseline`.
    - `extrapolation`: test rows beyond the trained inputs, rates and hold times, see `Extrapolation`.
    - `compensator`: figures of the inverse, plain data, as a program that inverts the model has found them;
      None where nobody has.
    - `purpose`: what the verdict is for: "predict", "compensate" or "constants".
    - `noise`: size and correlation of the residuals.
    - `noise_model`: what explains them, None where nothing does or nothing was tried; `noise_evidence`:
      -log evidence of every kind tried, over the best one's. `settings`: what the user gave for parameters.
    - `starts`: the objective of every start, for parametric models.
    - `used`: rows that were fitted, (samples,).
    - `detail`: what kind of fit it is, and what that kind holds: `Parametric`, `GridWeights`,
      `Composition`, `ReversalCurves`, `FoldedState` or `DiscreteSpectrum`.
    - `candidates`: all models tried, this one included, best first; of a loaded fit their figures alone.
    - `train`, `test`: the records it was fitted to and judged on, as the model saw them.
    - `clocks`: what was done to their input before; `predict` does the same.
    - `channels`: what combined several channels into that input, None where there is one.
    - `sequences`: terms that predict behind known rows better than states of the model do, None without.
    - `asked`: selection and options of the command that made a loaded fit, which `save` keeps.

    **Example:**

        >>> fit.name, fit.parameter_count, fit.trusted
        ('LinearSponge', 2, True)
        >>> fit.predict(record).shape
        (101,)
    """

    name: str
    model: AbstractModel
    parameters: tuple[Parameter, ...]
    covariance: Float[np.ndarray, "free free"]
    residuals: Float[np.ndarray, " samples"]
    used: Bool[np.ndarray, " samples"]
    metrics: dict[str, Metrics | None]
    success: bool
    score: float
    noise: Noise
    train: Record
    test: Record | None = None
    notes: tuple[str, ...] = ()
    blocks: Float[np.ndarray, " blocks"] | None = None
    test_blocks: Float[np.ndarray, " test_blocks"] | None = None
    baselines: tuple[Baseline, ...] = ()
    extrapolation: Extrapolation | None = None
    compensator: dict[str, Any] | None = None
    purpose: str = "predict"
    starts: Starts | None = None
    detail: Detail = Parametric()
    verdict: Verdict = Verdict("CAUTION", ())
    candidates: tuple["FitResult | Candidate", ...] = ()
    skipped: dict[str, str] = field(default_factory=dict)
    clocks: Clocks = Clocks()
    channels: ChannelMap | None = None
    sequences: SequenceTerms | None = None
    noise_model: NoiseModel | None = None
    noise_evidence: dict[str, float] = field(default_factory=dict)
    settings: Settings = field(default_factory=dict)
    asked: dict[str, Any] = field(default_factory=dict)
    seed: int = 0
    seconds: float = 0.0

    def __post_init__(self) -> None:
        # Whoever gets the model alone has to know what its numbers mean.
        record, seen = self.train, self.train.input[self.train.mask]
        units = Units(record.input_unit, record.output_unit, record.time_unit)
        known = seen.ndim == 1 and len(seen) > 0 and bool(np.isfinite(seen).all())
        model = with_units(self.model, units, (seen.min(), seen.max()) if known else None)
        object.__setattr__(self, "model", model)

    @property
    def trusted(self) -> bool:
        """Whether the answer can be used: the verdict is not FAIL and the solver converged."""
        return self.success and self.verdict.level != "FAIL"

    @property
    def parameter_count(self) -> int | None:
        """How many parameters were fitted, the noise's not counted; None for weights, which a prior holds
        together."""
        if self.detail.is_linear:
            return None
        return sum(p.status in ("free", "at bound", "unidentified") for p in self.parameters)

    def __getitem__(self, name: str) -> Parameter:
        """The parameter of this name, whatever its case: its `value`, `unit` and `stderr`.

        **Raises:** `InputError` `unknown-parameter`, which lists the names that are near.

        **Example:**

            >>> round(fit["K"].value, 2), fit["K"].unit
            (1.32, 'N / mm')
        """
        return named(self.parameters, name)

    @property
    def correlations(self) -> dict[str, dict[str, float]]:
        r"""Correlations of the parameters that have a standard error, by their names:

        ```math
        r_{ij} = C_{ij} / \sqrt{C_{ii} C_{jj}}
        ```

        C being the `covariance`. Near 1 or -1 the data tell one of the two only with the other.

        **Example:**

            >>> round(fit.correlations["K"]["b"], 2)
            -0.89
        """
        return correlated(self.parameters, self.covariance)

    @property
    def criteria(self) -> Criteria:
        r"""AIC and BIC of the likelihood that the fit maximised, for other models of the same rows:

        ```math
        AIC = 2 k - 2 \log L, \qquad BIC = k \log n - 2 \log L
        ```

        k counts the fitted parameters, those of the noise too, n the rows that were fitted.

        **Raises:** `InputError` `not-comparable` where they mean nothing: no noise model, or weights or
        parameters that a prior holds.

        **Example:**

            >>> line = hysid.fit([0, 1, 2, 3] * 9, [0.1, 1, 2, 3.2, 0, 1.1, 2, 3, 0] * 4, "LinearSponge",
            ...                  noise="gaussian", starts=2)
            >>> line.criteria.aic < line.criteria.bic
            True
        """
        return criteria_of(self)

    @in_own_precision
    def predict(
        self,
        record: Record | ArrayLike,
        time: ArrayLike | None = None,
        condition: ArrayLike | Mapping[str, ArrayLike] | None = None,
        known: int | str | None = None,
    ) -> Float[np.ndarray, " samples"]:
        """The model's output on new inputs, every sequence from the virgin state, as `hysid predict` gives
        it; also on `train` and `test`. With known rows each begins in the state that these tell.

        Every error, table and picture of a fit is of this prediction. Beyond the inputs of the fit, relays
        continue as play operators and conditions in a straight line, see `extended`; `beyond` marks those
        rows.

        **Arguments:**

        - `record`: a `Record`; or the inputs (n,) of one sequence, (n, channels) of a fit of several
          channels, in the units of the fit.
        - `time`: the times (n,) of inputs, which a model that depends on the rate needs.
        - `condition`: of inputs, what the output depends on too: (n,), one number, or those by their names.
        - `known`: of a record, how many first rows of each sequence tell its state, or the column that says
          so, see `fit`.

        **Returns:** the outputs (n,), in the unit of the fit's output.

        **Raises:** `InputError` `wrong-unit` where the record has other units than the fit's;
        `no-time` and `no-condition` where the model needs what is not given; `bad-option`,
        `length-mismatch`.

        **Example:**

            >>> fit.predict([0.0, 10.0, 20.0]).shape
            (3,)
        """
        if isinstance(record, Record) and known is not None:
            record = with_known(record, known)
        if not isinstance(record, Record):
            record = new_record(self.train, self.channels, record, time, condition)
        elif time is not None or condition is not None:
            raise InputError(
                "bad-option",
                "A record has its time and its conditions already.",
                fix="Leave out time= and condition=.",
            )
        if self.clocks.lag and record.time is None:
            raise InputError(
                "no-time",
                f"The output lags the input by {self.clocks.lag:.3g} {self.train.time_unit} in this fit.",
                fix="Give the times (time=).",
            )
        check_units(self, record, "input")
        record = self.clocks.applied(self.combined(record))
        if record.known is not None:
            return told(self, record).values
        # Without times the model itself runs, which knows whether it needs them.
        clocked = record.time is not None or self.train.time is None
        if clocked and (outputs := self.detail.outputs(record)) is not None:
            return outputs
        return predict(going_on(self.model, record), record)

    @property
    def condition(self) -> TrainedCondition | None:
        """The condition that the model depends on beside its input; None where it depends on none."""
        return trained_condition(self.model, self.train, self.blocks)

    @cached_property
    def characteristics(self) -> tuple[Characteristic, ...]:
        """What the specimen does: stiffness, loop width, energy, softening, zero drift, relaxation.

        Report, page, print and fit.json show these. An oscillator and several channels have none.

        **Example:**

            >>> [one.name for one in fit.characteristics][:2]
            ['stiffness', 'loop width']
        """
        if isinstance(self.detail, Motion) or self.channels is not None:
            return ()
        return characteristics(self.train, self.residuals, self.used)

    def loops(self) -> LoopTable:
        """The table of the fitted loops, see `Record.loops`; its `model` has those of the model beside.

        **Example:**

            >>> table = fit.loops()
            >>> bool(abs(table["stiffness"].value[0] / table.model["stiffness"].value[0] - 1) < 0.2)
            True
        """
        return fitted_loops(self.train, self.residuals, self.used)

    @property
    def determined(self) -> tuple[Parameter, ...]:
        """Parameters to show: of a linear fit the sums that the data determine, else all of them.

        **Example:**

            >>> [p.name for p in fit.determined]
            ['K', 'b', 'threshold']
        """
        if not self.detail.is_linear:
            return self.parameters
        return tuple(p for p in self.parameters if p.is_determined)

    def combined(self, record: Record) -> Record:
        """The record with its channels combined as in the fit; as it is where it has one input.

        A channel that was a condition in the fit is one again.

        Raises `InputError` `wrong-channels` where its inputs are not those of the fit.
        """
        if self.train.conditions and record.input_name != self.train.input_name:
            record = as_condition(record, self.train.input_name, self.train.conditions)
        return combine(record, self.channels)

    @property
    def trained(self) -> tuple[float, float]:
        """The least and the greatest input of the rows that counted in the fit.

        With channels both the values that the model was fitted to, of maps that did not see them, and those
        of the map of all rows.
        """
        seen = self.train.input[self.train.mask]
        if self.channels is not None and self.channels.trained is not None:
            seen = np.append(seen, self.channels.trained)
        return float(seen.min()), float(seen.max())

    def beyond(self, record: Record) -> Bool[np.ndarray, " samples"]:
        """Rows with an input, a channel of it, or a condition outside those that counted in the fit.

        The verdict, `predict` and everything else that says what is beyond asks here. Less than a hundredth
        of the trained range is no extrapolation.
        """
        u, (low, high) = self.combined(record).input, self.trained
        seam = SEAM * (high - low)
        outside = (u < low - seam) | (u > high + seam)
        if self.channels is not None and {*self.channels.names} <= {*record.columns}:
            outside |= beyond(record, self.channels, SEAM)
        if (condition := self.condition) is not None:
            outside |= condition.beyond(record)
        return outside

    def summary(self) -> str:
        """The fit in at most 30 lines: verdict, errors, parameters with units, candidates.

        **Example:**

            >>> print(fit.summary())
            LinearSponge: CAUTION
            ...
        """
        unit = self.train.output_unit
        errors = [
            (f"  {part}", f"{quantity(m.rmse, unit, 3)} rms", f"{m.nrmse_percent:.3g} % of the range",
             f"R2 {m.r2:.4f}")
            for part, m in self.metrics.items() if m is not None
        ]  # fmt: skip
        told = [one.cells for one in self.characteristics if one.value is not None]
        rows = [p.cells for p in self.determined]
        hidden = len(self.parameters) - len(rows)
        kind = "Composition" if isinstance(self.detail, Composition) else self.name
        ranked = [f"{fit.name} {fit.score:.3g} %" for fit in self.candidates]
        beside = [f"{one.name} {one.score:.3g} %" for one in self.baselines]
        return "\n".join([
            f"{kind}: {self.verdict.level}",
            *(["The specimen, by the model; how far the readings are from that"] if told else []),
            *aligned(told),
            *at_most([f"  {reason}" for reason in self.verdict.reasons], 7 if told else 9),
            "Errors",
            *aligned(errors),
            *([f"Model: {self.name}"] if kind != self.name else []),
            *(["Parameters", *at_most(aligned(rows), 7 if told else 14)] if rows else []),
            *([f"  {hidden} more are not determined by the data one by one"] if hidden else []),
            *([f"Candidates by held-out error: {', '.join(ranked)}"] if len(ranked) > 1 else []),
            *([f"Baselines by held-out error: {', '.join(beside)}"] if beside else []),
        ])  # fmt: skip

    def plot(self) -> Any:
        """Measured loops of the training and the held-out rows, and the model, as a matplotlib `Figure`.

        **Returns:** a `matplotlib.figure.Figure`, which a notebook shows and `savefig` writes.

        **Raises:** `InputError` `missing-extra` where matplotlib cannot be imported.
        """
        return plot_of(self)

    def __str__(self) -> str:
        return self.summary()

    def __repr__(self) -> str:
        return f"<FitResult {self.name}: {self.verdict.level}, {len(self.train)} rows>"

    def _repr_html_(self) -> str | None:
        return html_of(self)
