"""What programs built on identify share with it: the files of a fit, units, and constant-input tests.

These functions are documented and tested, and hysid uses them. They are not part of the public interface:
they may change with any release.
"""

from hysteresis._format import plain as plain
from hysteresis._verdict import Verdict as Verdict

from ._forc import Forc as Forc
from .baselines._contract import backwards as backwards
from .calibration._calibrate import calibrate as calibrate
from .calibration._excitation_design import choose as choose
from .comparison._compare import Compared as Compared
from .comparison._compare import Comparison as Comparison
from .comparison._compare import compare_candidates as compare_candidates
from .diagnostics._profile_likelihood import profiles as profiles
from .dynamics._periodic_tests import PeriodicTest as PeriodicTest
from .files._fit_folder import read_document as read_document
from .files._fit_folder import read_fit as read_fit
from .files._fit_folder import residuals_of_all as residuals_of_all
from .files._fit_folder import to_json as to_json
from .files._fit_folder import write_fit as write_fit
from .files._posterior import posterior_json as posterior_json
from .fitting._creep import is_at_first_row as is_at_first_row
from .fitting._creep import kind_of as kind_of
from .fitting._creep import stepped as stepped
from .fitting._creep import told_by_the_change as told_by_the_change
from .fitting._creep import way_of as way_of
from .linear._preisach_excitation import Identifiability as Identifiability
from .linear._preisach_excitation import excited_cells as excited_cells
from .noise._residual_statistics import estimate_noise as estimate_noise
from .posterior._log_posterior import target as target
from .posterior._posterior import Posterior as Posterior
from .records._folds import block_errors as block_errors
from .records._folds import root_difference as root_difference
from .records._new_record import predict as predict
from .results._detail import answers_over as answers_over
from .results._fit_result import check_units as check_units
from .results._goodness_of_fit import metrics as metrics
from .results._left_out import members_and_questions as members_and_questions
from .results._left_out import models_without_groups as models_without_groups
from .results._parameters import Parameter as Parameter
from .results._repeatability import repeatability as repeatability
from .results._trained_condition import told as told
from .spectra._of_record import MODULI as MODULI
from .spectra._of_record import PARTS as PARTS
from .spectra._of_record import RUNS as RUNS
from .spectra._of_record import is_moduli as is_moduli
from .spectra._of_record import is_survey as is_survey
from .spectra._of_record import runs_of as runs_of
from .spectra._of_record import sizes_of as sizes_of
from .storage._file_set import check_free as check_free
from .storage._file_set import read_checked as read_checked
from .storage._file_set import read_json as read_json
from .storage._file_set import sealed as sealed
from .storage._file_set import versions as versions
from .storage._file_set import whole_files as whole_files
from .storage._file_set import write_json as write_json
from .storage._file_set import write_set as write_set
from .training._train import train as train
