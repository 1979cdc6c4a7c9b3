"""Least squares with signs: optimality conditions, and SciPy as the slow oracle."""

import numpy as np
import pytest
import scipy.optimize
from hypothesis import given
from hypothesis import strategies as st

from identify.linear._nnls import constrained_least_squares, nonnegative_least_squares

sizes = st.tuples(st.integers(1, 25), st.integers(0, 2**32 - 1))


def problem(n: int, seed: int, rows: int | None = None) -> tuple[np.ndarray, np.ndarray]:
    """A, y with columns of very different size, so that half of x would be negative."""
    random = np.random.default_rng(seed)
    A = random.normal(size=(rows or 2 * n + 3, n)) * 10 ** random.uniform(-1, 1, n)
    return A, random.normal(size=len(A))


@given(sizes)
def test_equals_scipy(size: tuple[int, int]) -> None:
    A, y = problem(*size)
    x = nonnegative_least_squares(A.T @ A, A.T @ y)
    oracle, _ = scipy.optimize.nnls(A, y)
    # The normal equations square the condition number, at most about 1e3 here: 1e6 * 1e-16 of x.
    np.testing.assert_allclose(x, oracle, atol=1e-9 * max(np.abs(oracle).max(), 1e-3))


@given(sizes)
def test_constraints_hold_and_the_minimum_is_one(size: tuple[int, int]) -> None:
    n, seed = size
    A, y = problem(n, seed)
    H, b = A.T @ A, A.T @ y
    C = np.random.default_rng(seed + 1).normal(size=(max(1, n // 3), n))
    x = constrained_least_squares(H, b, C, rounds=200)
    scale = np.abs(x).max(initial=1e-3)
    assert (x >= 0).all()
    assert (C @ x >= -1e-7 * scale).all()

    def objective(z: np.ndarray) -> float:
        return float(z @ H @ z / 2 - b @ z)

    oracle = scipy.optimize.minimize(
        objective, np.maximum(x, 1e-6), jac=lambda z: H @ z - b, method="SLSQP",
        bounds=[(0, None)] * n, constraints={"type": "ineq", "fun": lambda z: C @ z, "jac": lambda z: C},
        options={"maxiter": 500, "ftol": 1e-14},
    )  # fmt: skip
    if oracle.success:
        # SLSQP stops at ftol on the objective; ours may be lower, not higher.
        assert objective(x) <= oracle.fun + 1e-6 * (abs(oracle.fun) + 1e-6)


def test_ill_conditioned_is_refused_by_the_factorisation() -> None:
    with pytest.raises(np.linalg.LinAlgError):
        nonnegative_least_squares(np.zeros((3, 3)), np.ones(3))
