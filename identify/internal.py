"""What programs built on identify share with it: the files of a fit, units, and constant-input tests.

These functions are documented and tested, and hysid uses them. They are not part of the public interface:
they may change with any release.

- Files: `residuals_of_all`, `plain`, `read_json`, `write_json`, `sealed`, `check_free`, `read_document`,
  `read_fit`, `write_fit`, `replace_fits`, `write_set`, `stage_set`, `whole_files`, `check_unedited`,
  `to_json`, `posterior_json`, `versions`.
- Units: `check_unit`.
- Errors in blocks of rows, and the difference of two: `block_errors`, `root_difference`.
- Simple inverses, with which a compensator is compared: `backwards`.
- The models of a fit without each cycle of its rows: `models_without_groups`.
- Creep and relaxation: `stepped`, `is_at_first_row`, `kind_of`, `told_by_the_change`, `way_of`.
"""

from hysteresis._format import plain

from .baselines._backwards import backwards
from .files._fit_folder import read_document, read_fit, residuals_of_all, to_json, write_fit
from .files._posterior import posterior_json
from .files._several_fits import replace_fits
from .fitting._creep import is_at_first_row, stepped, way_of
from .fitting._creep_kind import kind_of, told_by_the_change
from .records._folds import block_errors, root_difference
from .results._fit_result import check_unit
from .results._left_out import models_without_groups
from .storage._file_set import check_unedited, sealed, stage_set, whole_files, write_set
from .storage._json import check_free, read_json, write_json
from .storage._provenance import versions

__all__ = [
    "backwards",
    "block_errors",
    "check_free",
    "check_unedited",
    "check_unit",
    "is_at_first_row",
    "kind_of",
    "models_without_groups",
    "plain",
    "posterior_json",
    "read_document",
    "read_fit",
    "read_json",
    "replace_fits",
    "residuals_of_all",
    "root_difference",
    "sealed",
    "stage_set",
    "stepped",
    "to_json",
    "told_by_the_change",
    "versions",
    "way_of",
    "whole_files",
    "write_fit",
    "write_json",
    "write_set",
]
