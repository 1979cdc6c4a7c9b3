"""`hysid.report`: the page about a fit in memory."""

from pathlib import Path
from tempfile import TemporaryDirectory

import identify
from hysteresis._precision import in_own_precision
from identify import save_posterior

from ._case import TARGET
from ._fit_page import write_report


@in_own_precision
def report(
    fit: identify.FitResult,
    path: str | Path = TARGET,
    posterior: identify.internal.Posterior | None = None,
) -> Path:
    """Write the report of a fit, and of its posterior, as one HTML file that needs no other.

    **Arguments:**

    - `fit`: what `fit` or `fit_step` returned.
    - `path`: the file, which is overwritten.
    - `posterior`: what `sample` returned for this fit.

    **Returns:** the path of the file.

    **Raises:** `InputError` `cannot-write` where the file cannot be written.

    **Example:**

        >>> hysid.report(fit, folder / "fit.html").name
        'fit.html'
    """
    with TemporaryDirectory() as folder:
        identify.save(fit, folder, overwrite=True)
        if posterior is not None:
            save_posterior(posterior, folder)
        return write_report(folder, Path(path))
