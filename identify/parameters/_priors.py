"""Prior distributions of a parameter."""

import re
from typing import Any, Literal, NamedTuple, get_args

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from hysteresis import InputError

Kind = Literal["normal", "log-normal", "half-normal", "uniform"]

MEANING = {
    "normal": "normal(mean, deviation)",
    "log-normal": "log-normal(median, factor)",
    "half-normal": "half-normal(scale)",
    "uniform": "uniform(low, high)",
}


class Prior(NamedTuple):
    """A prior distribution of one parameter:

        normal(m, s)        x is Gaussian with mean m and standard deviation s
        log-normal(m, f)    log x is Gaussian with mean log m and standard deviation log f
        half-normal(s)      |x|, where x is Gaussian with mean 0 and standard deviation s
        uniform(a, b)       x is uniform between a and b

    `default`: derived from the scale of the data, and so weak that a fit ignores it.
    """

    kind: Kind
    first: float
    second: float = 0.0
    default: bool = False

    def __str__(self) -> str:
        numbers = [self.first] if self.kind == "half-normal" else [self.first, self.second]
        return f"{self.kind}({', '.join(f'{x:.12g}' for x in numbers)})"

    @property
    def support(self) -> tuple[float, float]:
        """The interval outside which the density is zero."""
        if self.kind == "uniform":
            return self.first, self.second
        return (-float("inf") if self.kind == "normal" else 0.0), float("inf")

    def penalty(self, x: Float[Array, ""]) -> Float[Array, ""]:
        """-log density up to a constant, with respect to x, or to log x if log-normal; infinite outside the
        support."""
        if self.kind == "normal":
            return ((x - self.first) / self.second) ** 2 / 2
        if self.kind == "uniform":
            return jnp.where((x > self.first) & (x < self.second), 0.0, jnp.inf)
        inside = jnp.where(x > 0, x, 1.0)
        if self.kind == "half-normal":
            z = inside / self.first
        else:
            z = jnp.log(inside / self.first) / np.log(self.second)
        return jnp.where(x > 0, z**2 / 2, jnp.inf)

    def log_density(self, x: Float[Array, ""]) -> Float[Array, ""]:
        """log p(x), normalised with respect to x."""
        if self.kind == "uniform":
            return -self.penalty(x) - np.log(self.second - self.first)
        if self.kind == "half-normal":
            return -self.penalty(x) - np.log(self.first) + 0.5 * np.log(2 / np.pi)
        log_deviation = np.log(self.second)
        if self.kind == "log-normal":
            return -self.penalty(x) - np.log(log_deviation * np.sqrt(2 * np.pi)) - jnp.log(x)
        return -self.penalty(x) - log_deviation - 0.5 * np.log(2 * np.pi)

    def draws(self, random: np.random.Generator, count: int) -> Float[np.ndarray, " count"]:
        """Independent draws."""
        if self.kind == "uniform":
            return random.uniform(self.first, self.second, count)
        z = random.normal(size=count)
        if self.kind == "normal":
            return self.first + self.second * z
        return np.abs(self.first * z) if self.kind == "half-normal" else self.first * self.second**z


def prior(said: Any, of: str = "a parameter") -> Prior:
    """A prior from text such as "log-normal(100, 2)"; a `Prior` is returned as it is.

    Raises `InputError` `bad-prior` if the text is not a prior, or its numbers are not valid.
    """
    if isinstance(said, Prior):
        return said
    found = re.fullmatch(r"\s*([a-z-]+)\s*\(([^()]*)\)\s*", str(said))
    try:
        assert found is not None
        assert found[1] in get_args(Kind)
        numbers = [float(word) for word in found[2].split(",")]
        assert len(numbers) == (1 if found[1] == "half-normal" else 2)
    except (AssertionError, ValueError):
        raise InputError(
            "bad-prior",
            f"{said!r} is not a prior for {of}.",
            fix=f"write one of {'; '.join(MEANING.values())}.",
        ) from None
    made = Prior(found[1], *numbers)  # type: ignore[arg-type]
    first, second = made.first, made.second
    sound = {
        "normal": second > 0,
        "log-normal": first > 0 and second > 1,
        "half-normal": first > 0,
        "uniform": first < second,
    }[made.kind]
    if not (sound and all(np.isfinite(numbers))):
        raise InputError(
            "bad-prior",
            f"{made} for {of} is not a distribution.",
            fix="give a deviation above 0, a factor above 1, a median above 0, and low below high.",
        )
    return made
