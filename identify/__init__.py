"""Learning a model from records: fits, posteriors, verdicts."""

from ._fit import fit as fit
from ._metrics import Metrics as Metrics
from ._metrics import metrics as metrics
from ._noise import Noise as Noise
from ._noise import estimate_noise as estimate_noise
from ._posterior import Posterior as Posterior
from ._posterior import sample as sample
from ._posterior_file import load_posterior as load_posterior
from ._posterior_file import posterior_json as posterior_json
from ._posterior_file import save_posterior as save_posterior
from ._result import FitResult as FitResult
from ._result import Parameter as Parameter
from ._result import Verdict as Verdict
from ._result import predict as predict
from ._save import check_free as check_free
from ._save import load as load
from ._save import plain as plain
from ._save import read_document as read_document
from ._save import save as save
from ._save import to_json as to_json
from ._save import write_json as write_json
