"""Parameters that made a record are found from a start a decade away from each."""

import numpy as np
import pytest

from hysteresis import InputError, MonotoneCurve, Record
from identify import fit


def test_starts_without_a_finite_output_are_refused() -> None:
    u = np.linspace(0.0, 1.0, 50)
    with pytest.raises(InputError, match=r"\[no-finite-start\]"):
        fit(Record.from_arrays(u, 2 * u), MonotoneCurve.even(0.0, 1.0, [1.0], np.nan), starts=4)
