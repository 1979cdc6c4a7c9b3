"""The classical Runge-Kutta method, of fourth order."""

from collections.abc import Callable
from typing import Any

import jax


def runge_kutta(slopes: Callable[[Any, float], Any], start: Any, h: Any) -> Any:
    """x after a step h of dx/dt = slopes(x, share), `share` how much of the step is over.

        x + h (k1 + 2 k2 + 2 k3 + k4) / 6

    x is an array, or a tree of arrays.
    """

    def later(by: Any, step: Any) -> Any:
        return jax.tree.map(lambda x, d: x + step * d, start, by)

    k1 = slopes(start, 0.0)
    k2 = slopes(later(k1, 0.5 * h), 0.5)
    k3 = slopes(later(k2, 0.5 * h), 0.5)
    k4 = slopes(later(k3, h), 1.0)
    return jax.tree.map(
        lambda x, a, b, c, d: x + h * (a + 2 * b + 2 * c + d) / 6, start, k1, k2, k3, k4
    )
