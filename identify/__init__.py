"""Learning a model from records: fits, posteriors, verdicts."""

from ._fit import fit as fit
from ._metrics import Metrics as Metrics
from ._metrics import metrics as metrics
from ._noise import Noise as Noise
from ._noise import estimate_noise as estimate_noise
from ._result import FitResult as FitResult
from ._result import Parameter as Parameter
from ._result import Verdict as Verdict
from ._result import predict as predict
