"""Learning a model from records: fits, posteriors, verdicts."""

# hysid:own-package, which hysid/_packages.py looks for

import inspect

from hysteresis._precision import in_double as _in_double
from hysteresis._verdict import Verdict

from . import internal
from .batch._fit_many import fit_many
from .batch._folder import Batch
from .calibration._calibrate import Calibrated, Calibration, calibrate
from .calibration._excitation_design import Excitation, design_excitation, multisine
from .calibration._optimal_design import Choice, choose
from .comparison._change import Change, ParameterChange, change
from .comparison._compare import Compared, Comparison, Difference, Pair, compare, compare_candidates
from .comparison._pooling import Interval, Pooled, PooledParameter, pool
from .comparison._psis_loo import Loo
from .diagnostics._profile_likelihood import Profile, profile, profiles
from .diagnostics._residual_breakdown import Breakdown, breakdown
from .diagnostics._sensitivity import Sensitivity, sensitivity
from .diagnostics._sloppiness import Sloppiness, sloppiness
from .diagnostics._whiteness import Whiteness, whiteness
from .dynamics._recorded_motion import RecordedMotion
from .files._fit_folder import load, save
from .files._posterior import load_posterior, save_posterior
from .fitting._creep import fit_step
from .fitting._fit import fit
from .forc._curves import Forc, forc_curves
from .forc._diagram import ForcDiagram, forc_diagram
from .forc._everett import EverettSurface, everett_surface
from .linear._density_fit import (
    BlockDensityFit,
    DensityFit,
    fit_density,
    fit_density_in_blocks,
)
from .linear._preisach_excitation import (
    Design,
    Identifiability,
    design,
    excited_cells,
    identifiability,
)
from .noise._residual_statistics import Noise, estimate_noise
from .posterior._log_posterior import Target, target
from .posterior._posterior import Posterior
from .posterior._predictive import LEVELS, Bands, predictive
from .posterior._sample import sample
from .records._run_model import predict
from .results._baseline import Baseline
from .results._characteristics import Characteristic
from .results._detail import (
    Composition,
    DiscreteSpectrum,
    FoldedState,
    GridWeights,
    Parametric,
    ReversalCurves,
)
from .results._extrapolation import Extrapolation, RowsBeyond
from .results._fit_result import Candidate, FitResult, Parameter, Starts
from .results._metrics import Metrics, metrics
from .results._motion_detail import Motion
from .results._repeatability import Repeatability, repeatability
from .results._trained_condition import TrainedCondition
from .spectra._spectrum import Spectrum, spectrum
from .training._gaussian_process import fit_kernel
from .training._train import Trained, train

__all__ = [
    "LEVELS",
    "Bands",
    "Baseline",
    "Batch",
    "BlockDensityFit",
    "Breakdown",
    "Calibrated",
    "Calibration",
    "Candidate",
    "Change",
    "Characteristic",
    "Choice",
    "Compared",
    "Comparison",
    "Composition",
    "DensityFit",
    "Design",
    "Difference",
    "DiscreteSpectrum",
    "EverettSurface",
    "Excitation",
    "Extrapolation",
    "FitResult",
    "FoldedState",
    "Forc",
    "ForcDiagram",
    "GridWeights",
    "Identifiability",
    "Interval",
    "Loo",
    "Metrics",
    "Motion",
    "Noise",
    "Pair",
    "Parameter",
    "ParameterChange",
    "Parametric",
    "Pooled",
    "PooledParameter",
    "Posterior",
    "Profile",
    "RecordedMotion",
    "Repeatability",
    "ReversalCurves",
    "RowsBeyond",
    "Sensitivity",
    "Sloppiness",
    "Spectrum",
    "Starts",
    "Target",
    "Trained",
    "TrainedCondition",
    "Verdict",
    "Whiteness",
    "breakdown",
    "calibrate",
    "change",
    "choose",
    "compare",
    "compare_candidates",
    "design",
    "design_excitation",
    "estimate_noise",
    "everett_surface",
    "excited_cells",
    "fit",
    "fit_density",
    "fit_density_in_blocks",
    "fit_kernel",
    "fit_many",
    "fit_step",
    "forc_curves",
    "forc_diagram",
    "identifiability",
    "internal",
    "load",
    "load_posterior",
    "metrics",
    "multisine",
    "pool",
    "predict",
    "predictive",
    "profile",
    "profiles",
    "repeatability",
    "sample",
    "save",
    "save_posterior",
    "sensitivity",
    "sloppiness",
    "spectrum",
    "target",
    "train",
    "whiteness",
]

# Here, and not in their files: inside, one has called the other, and the precision is right.
for _name, _thing in {name: globals()[name] for name in __all__}.items():
    # Of these two the user's own JAX code is a part, which keeps its precision.
    if inspect.isfunction(_thing) and _name not in ("calibrate", "train"):
        globals()[_name] = _in_double(_thing)
