"""Vector fitting: common poles of outputs Y of inputs U, by moving them until they no longer move.

    sigma Y = sum over inputs of (sum r_m / (s - p_m) + d) U,     sigma = sum c_m / (s - p_m) + c_0

is linear in r, d, c and c_0, and the zeros of sigma are the next poles p. For frequency responses U is 1.
Each output's own unknowns are eliminated by a QR decomposition: a step costs outputs x lines x columns^2.

Source: Gustavsen and Semlyen 1999; relaxed, Gustavsen 2006; fast, Deschrijver et al. 2008.
"""

from typing import Any

import numpy as np
from jaxtyping import Complex, Float

Responses = Complex[np.ndarray, "lines responses"] | Any


def basis_of(s: Any, poles: Any) -> Complex[np.ndarray, "lines columns"]:
    """Two columns for each pair of poles, whose weights are the real and imaginary parts of its residue."""
    one, other = (1 / (s[:, None] - p) for p in (poles, poles.conj()))
    both = np.stack([one + other, 1j * (one - other)], 2)
    return both.reshape(len(s), -1)


def vector_fitted(
    s: Any, inputs: Any, responses: Responses, poles: Any, steps: int = 20
) -> tuple[Any, Any, Float[np.ndarray, "inputs responses"]]:
    """Poles (poles,) of positive imaginary part, residues (inputs, poles, responses), direct terms."""
    for _ in range(steps):
        poles = _moved(s, inputs, responses, poles)
    _, driven = _columns(s, inputs, poles)
    found = np.linalg.lstsq(driven, real(responses), rcond=None)[0]
    found = found.reshape(inputs.shape[1], -1, responses.shape[1])
    return poles, found[:, 0:-1:2] + 1j * found[:, 1:-1:2], found[:, -1]


def _columns(s: Any, inputs: Any, poles: Any) -> tuple[Any, np.ndarray]:
    """The basis with a direct term, and the real columns of all inputs through it."""
    wide = np.column_stack([basis_of(s, poles), np.ones(len(s))])
    return wide, real(np.hstack([wide * u[:, None] for u in inputs.T]))


def _moved(s: Any, inputs: Any, responses: Responses, poles: Any) -> Any:
    wide, driven = _columns(s, inputs, poles)
    own, rows = np.linalg.qr(driven)[0], []
    for response in responses.T:
        sigma = real(-wide * response[:, None])
        rows.append(np.linalg.qr(sigma - own @ (own.T @ sigma), mode="r"))
    # sigma does not vanish: its mean over the lines is 1 (the relaxed condition).
    size = np.linalg.norm(responses) / len(s)
    left = np.vstack([*rows, size * wide.real.sum(0)])
    right = np.zeros(len(left))
    right[-1] = size * len(s)
    each = np.linalg.norm(left, axis=0)
    solution = np.linalg.lstsq(left / each, right, rcond=None)[0] / each
    c, c0 = solution[:-1], solution[-1] if abs(solution[-1]) > 1e-8 else 1e-8
    a: Any = np.zeros((len(c), len(c)))
    b = np.zeros(len(c))
    for i, p in enumerate(poles):
        a[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = [[p.real, p.imag], [-p.imag, p.real]]
        b[2 * i] = 2.0
    zeros = np.linalg.eigvals(a - np.outer(b, c) / c0)
    zeros = zeros - 2 * np.maximum(zeros.real, 0)  # a pole that grows is mirrored
    kept = zeros[zeros.imag > 1e-9 * np.abs(zeros)]
    return kept[np.argsort(kept.imag)]


def real(x: Any) -> np.ndarray:
    """Rows of real parts, then of imaginary ones."""
    return np.concatenate([x.real, x.imag])
