"""Least squares with signs: optimality conditions, and SciPy as the slow oracle."""

import numpy as np
import pytest
import scipy.optimize
from hypothesis import given
from hypothesis import strategies as st

from identify.linear._nnls import _Minima, constrained_least_squares, nonnegative_least_squares

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
def test_optimality(size: tuple[int, int]) -> None:
    A, y = problem(*size)
    H, b = A.T @ A, A.T @ y
    free = np.random.default_rng(size[1]).uniform(size=size[0]) < 0.3
    x = nonnegative_least_squares(H, b, free)
    gradient = H @ x - b
    rounding = 1e-10 * np.abs(b).max()
    assert (x[~free] >= 0).all()
    assert (gradient >= -rounding)[~free].all()
    assert np.abs(gradient[(x != 0) | free]).max(initial=0) <= rounding


def test_start_does_not_change_the_answer() -> None:
    A, y = problem(30, 5)
    H, b = A.T @ A, A.T @ y
    x = nonnegative_least_squares(H, b)
    for start in (x == 0, x != 0, np.zeros(30, bool)):
        # Cholesky factors of the same final set: equal to rounding.
        np.testing.assert_allclose(nonnegative_least_squares(H, b, start=start), x, rtol=1e-9)


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


def test_constraints_that_do_not_bind_change_nothing() -> None:
    A, y = problem(12, 3)
    H, b = A.T @ A, A.T @ y
    x = nonnegative_least_squares(H, b)
    C = np.ones((1, 12))  # a sum of non-negative numbers
    np.testing.assert_allclose(constrained_least_squares(H, b, C), x, atol=1e-8 * x.max())


def test_ill_conditioned_is_refused_by_the_factorisation() -> None:
    with pytest.raises(np.linalg.LinAlgError):
        nonnegative_least_squares(np.zeros((3, 3)), np.ones(3))


def test_minima_over_sets_that_differ_by_a_few_are_those_of_factors_of_their_own() -> None:
    """x_S = H_SS^-1 b_S, to rounding times the condition of H; also of no variables."""
    random = np.random.default_rng(4)
    A = random.normal(size=(80, 60))
    H, b = A.T @ A, A.T @ random.normal(size=80)
    minima, inside = _Minima(H, b), random.random(60) < 0.7
    first, exact = inside.copy(), []
    for changed in (0, 1, 2, 5, 40, 3):
        inside = inside.copy()
        inside[random.choice(60, changed, replace=False)] ^= True
        at = np.flatnonzero(inside)
        wanted = np.zeros(60)
        wanted[at] = np.linalg.solve(H[np.ix_(at, at)], b[at])
        np.testing.assert_allclose(minima(inside), wanted, atol=1e-11 * np.abs(wanted).max())
        exact.append(minima.is_exact)
    assert exact[:4] == [True, False, False, False]
    minima.begin_at(first)
    minima(inside)
    assert not minima(np.zeros(60, bool)).any()
    minima(first)
    assert minima.is_exact
