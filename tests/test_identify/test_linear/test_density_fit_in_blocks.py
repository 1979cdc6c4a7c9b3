"""A grid fitted block by block is the one fitted to all rows at once."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from hysteresis import InputError, Record, row_blocks
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


def parquet(path: Path, u: np.ndarray, y: np.ndarray) -> None:
    pyarrow = pytest.importorskip("pyarrow")
    import pyarrow.parquet as pq  # only where it is installed

    pq.write_table(pyarrow.table({"other": 0 * u, "y": y, "u (A/m)": u}), path)


def npy(path: Path, u: np.ndarray, y: np.ndarray) -> None:
    table = np.empty(len(u), [("u (A/m)", float), ("y", np.float32)])
    table["u (A/m)"], table["y"] = u, y
    np.save(path, table)


def csv(path: Path, u: np.ndarray, y: np.ndarray) -> None:
    table = np.column_stack([y, u])
    np.savetxt(path, table, "%.17g", ",", header='y,"u (A/m)"', comments="")


@pytest.mark.parametrize("write", [parquet, npy, csv])
def test_files_are_read_in_blocks(
    tmp_path: Path, write: Callable[[Path, np.ndarray, np.ndarray], None]
) -> None:
    u, y = columns()
    path = tmp_path / f"long.{write.__name__}"
    write(path, u, y)
    blocks = list(row_blocks(path, ("u (A/m)", "y"), 250))
    assert [len(block[0]) for block in blocks] == [250, 250, 100]
    np.testing.assert_array_equal(np.concatenate([b[0] for b in blocks]), u)
    np.testing.assert_allclose(np.concatenate([b[1] for b in blocks]), y, rtol=1e-6)
    with pytest.raises(InputError, match="no column 'v'"):
        next(row_blocks(path, ("v",)))


def test_errors_say_what_is_wrong(tmp_path: Path) -> None:
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
    (tmp_path / "long.csv").write_text("u,y\n1,2\n1,broken\n")
    for name, code in [("long.csv", "not-numbers"), ("long.xlsx", "unreadable-file")]:
        with pytest.raises(InputError) as raised:
            list(row_blocks(tmp_path / name, ("u", "y")))
        assert raised.value.code == code
