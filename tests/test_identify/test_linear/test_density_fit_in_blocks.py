"""A grid fitted block by block is the one fitted to all rows at once."""

import numpy as np
import pytest

from hysteresis import InputError, Record
from identify import fit_density, fit_density_in_blocks

ROWS = 600


def columns(seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """A zigzag and play operators of it."""
    random = np.random.default_rng(seed)
    u = np.interp(np.arange(ROWS) / 9, np.arange(ROWS // 9 + 2), random.uniform(size=ROWS // 9 + 2))
    play, radii, y = np.zeros(3), np.array([0.05, 0.2, 0.4]), []
    for x in u:
        play = np.clip(play, x - radii, x + radii)
        y.append(play.sum())
    return u, np.array(y) + 0.01 * random.normal(size=ROWS)


@pytest.mark.parametrize(("leading", "initial"), [(False, "negative"), (True, "demagnetised")])
def test_blocks_give_the_weights_of_the_whole(leading: bool, initial: str) -> None:
    u, y = columns()
    if leading:
        y = 3 * u - y
    options = {"strength": 1e-3, "low": 0.0, "high": 1.0, "leading": leading, "initial": initial}
    whole = fit_density(Record.from_arrays(u, y), 8, **options)  # type: ignore[arg-type]
    cuts = np.sort(np.random.default_rng(1).integers(1, ROWS, 12))  # some blocks may be empty
    blocks = zip(np.split(u, cuts), np.split(y, cuts), strict=True)
    found = fit_density_in_blocks(blocks, 8, **options)  # type: ignore[arg-type]
    # The same sums in another order.
    np.testing.assert_allclose(found.unknowns, whole.unknowns, rtol=0, atol=1e-8)
    assert found.rows == ROWS
    assert found.rmse == pytest.approx(np.sqrt(np.mean(whole.residuals**2)), rel=1e-6)


def test_errors_say_what_is_wrong() -> None:
    u, y = columns()
    for blocks, code in [
        ([(2 * u, y)], "out-of-range"),
        ([(u, y), (np.array([np.nan]), np.array([0.0]))], "not-numbers"),
        ([(u, 0 * y)], "zero-range"),
        ([], "zero-range"),
    ]:
        with pytest.raises(InputError) as raised:
            fit_density_in_blocks(blocks, 4, low=0.0, high=1.0, strength=1e-3)
        assert raised.value.code == code
