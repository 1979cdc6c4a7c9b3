"""User settings of parameters: start value, bounds, prior, fixed, tied."""

import difflib
import re
from collections.abc import Mapping
from typing import Any, Literal, NamedTuple, TypedDict, TypeVar, get_args

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from hysteresis import InputError, parameters
from hysteresis._parameter import ParameterInfo, parameter_at

# Prior distributions of a parameter.

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


Model = TypeVar("Model", bound=eqx.Module)

KEYS = ("start", "bounds", "prior", "fixed", "tied")


class Setting(NamedTuple):
    """The settings of one parameter.

    - `bounds`: the fit stays between them. `prior`: its prior distribution.
    - `fixed`: it keeps its start value. `tied`: (name, factor): it equals that factor times another one.
    """

    bounds: tuple[float, float] | None = None
    prior: Prior | None = None
    fixed: bool = False
    tied: tuple[str, float] | None = None


Settings = dict[str, Setting]


class SettingWords(TypedDict):
    """A setting as plain data."""

    bounds: list[float | None] | None
    prior: str | None
    fixed: bool
    tied: str | None


def with_settings(model: Model, said: Mapping[str, Mapping[str, Any]]) -> tuple[Model, Settings]:
    """The model with the given start and fixed values, and the other settings.

    `said`: name of a parameter -> {"start": number, "bounds": [low, high], "prior": "log-normal(100, 2)",
    "fixed": true or a number, "tied": "2 * E1"}; the numbers of an array are "tau.0", "tau.1".

    Raises `InputError` for an unknown name or key, bounds in the wrong order, a start on or outside them or
    where the prior density is zero, a tie to a parameter that is tied itself, and a value that the model
    cannot have.
    """
    numbers = {name: info for name, info, _ in numbers_of(model)}
    settings: Settings = {}
    for name, words in said.items():
        if name not in numbers:
            alike = {number.casefold(): number for number in numbers}
            near = difflib.get_close_matches(name.casefold(), alike, 1)
            raise InputError(
                "unknown-parameter",
                f"{type(model).__name__} has no parameter {name!r}; it has {', '.join(numbers)}.",
                fix=f"did you mean {alike[near[0]]}?" if near else "name one of these.",
            )
        model, settings[name] = _said(model, name, numbers[name], words)
    for name, setting in settings.items():
        if setting.tied is None:
            continue
        source, factor = setting.tied
        if source not in numbers:
            raise InputError("bad-tie", f"{name} is tied to {source!r}, which is not a parameter.")
        if source == name or settings.get(source, Setting()).tied is not None:
            raise InputError("bad-tie", f"{name} is tied to {source}, which is tied itself.")
        model = replaced(model, name, factor * float(parameter_at(model, source)))
    # A changed model skips the checks of its class, and a saved one would not load.
    for kind in type(model).__mro__ if settings else ():
        vars(kind).get("__check_init__", lambda _: None)(model)
    return model, settings


def in_words(settings: Settings) -> dict[str, dict[str, Any]]:
    """Settings as plain data; `from_words` is the inverse."""
    return {
        name: {
            "bounds": None if s.bounds is None else list(s.bounds),
            "prior": None if s.prior is None else str(s.prior),
            "fixed": s.fixed,
            "tied": None if s.tied is None else f"{s.tied[1]!r} * {s.tied[0]}",
        }
        for name, s in settings.items()
    }


def from_words(words: Mapping[str, Mapping[str, Any]]) -> Settings:
    """The inverse of `in_words`."""

    def bounds(said: Any) -> tuple[float, float] | None:
        if said is None:
            return None
        low, high = (
            side if x is None else x for x, side in zip(said, (-np.inf, np.inf), strict=True)
        )
        return low, high

    return {
        name: Setting(
            bounds(w["bounds"]),
            None if w["prior"] is None else prior(w["prior"], name),
            w["fixed"],
            None if w["tied"] is None else _tie(name, w["tied"]),
        )
        for name, w in words.items()
    }


def numbers_of(model: eqx.Module) -> list[tuple[str, ParameterInfo, float]]:
    """Every scalar parameter of a model; entries of a one-dimensional array are named by their index."""
    return [
        (name if value.ndim == 0 else f"{name}.{k}", info, float(number))
        for name, info, value in parameters(model)
        if value is not None and value.ndim <= 1
        for k, number in enumerate(np.ravel(value))
    ]


def replaced(model: Model, name: str, value: Any) -> Model:
    """The model with one parameter changed."""
    whole, _, place = name.rpartition(".")
    if place.isdigit() and eqx.is_array(array := parameter_at(model, whole)):
        return eqx.tree_at(lambda m: parameter_at(m, whole), model, array.at[int(place)].set(value))
    old = parameter_at(model, name)
    return eqx.tree_at(lambda m: parameter_at(m, name), model, jnp.asarray(value, old.dtype))


def _said(
    model: Model, name: str, info: ParameterInfo, words: Mapping[str, Any]
) -> tuple[Model, Setting]:
    if odd := [key for key in words if key not in KEYS]:
        raise InputError("unknown-key", f"{name} has no {odd[0]!r}.", fix=f"say {', '.join(KEYS)}.")
    bounds = None if words.get("bounds") is None else _bounds(name, words["bounds"])
    belief = None if words.get("prior") is None else prior(words["prior"], name)
    fixed = words.get("fixed", False)
    start = words.get("start")
    if fixed is not True and fixed is not False:
        start, fixed = fixed, True
    if start is not None:
        model = replaced(model, name, _number(name, start))
    tied = None if words.get("tied") is None else _tie(name, str(words["tied"]))
    if tied is not None and (fixed or start is not None):
        raise InputError(
            "bad-tie", f"{name} is tied, so it cannot also be fixed or have a start value."
        )
    value = float(parameter_at(model, name))
    low, high = bounds or info.bounds
    if not fixed and tied is None and not low < value < high:
        where = "on a bound" if value in (low, high) else "outside"
        raise InputError(
            "start-out-of-bounds",
            f"{name} starts at {value:g}, {where} of ({low:g}, {high:g}).",
            cause="the gradient vanishes on a bound." if value in (low, high) else "",
            fix="start inside the bounds, or fix the parameter (fixed = true).",
        )
    if (
        belief is not None
        and not fixed
        and not np.isfinite(float(belief.penalty(jnp.asarray(value))))
    ):
        raise InputError(
            "start-out-of-bounds",
            f"{name} starts at {value:g}, where the density of its prior {belief} is zero.",
            fix="start inside the prior's support, or widen the prior.",
        )
    if belief is not None:
        # Search inside the prior's support; a positive parameter is then searched by its logarithm.
        bounds = max(low, belief.support[0]), min(high, belief.support[1])
    return model, Setting(bounds, belief, bool(fixed), tied)


def _number(name: str, said: Any) -> float:
    try:
        return float(said)
    except (TypeError, ValueError):
        raise InputError("not-numbers", f"{said!r}, given for {name}, is not a number.") from None


def _bounds(name: str, said: Any) -> tuple[float, float]:
    try:
        low, high = (float(x) for x in said)
    except (TypeError, ValueError):
        raise InputError(
            "bad-bounds", f"{said!r}, given for {name}, are not bounds.", fix="write [low, high]."
        ) from None
    if not low < high:
        raise InputError(
            "bad-bounds",
            f"{name} has the bounds [{low:g}, {high:g}].",
            cause="the lower bound must be below the upper one.",
            fix="swap them, or fix the parameter.",
        )
    return low, high


def _tie(name: str, said: str) -> tuple[str, float]:
    found = re.fullmatch(r"\s*(?:([-+.\deE]+)\s*\*\s*)?([A-Za-z_][\w.]*)\s*", said)
    try:
        assert found is not None
        return found[2], float(found[1] or 1)
    except (AssertionError, ValueError):
        raise InputError(
            "bad-tie", f"{said!r}, given for {name}, is not a tie.", fix='write "E1" or "2 * E1".'
        ) from None


# Double precision, without which fits stop early and errors come out wrong.


def require_double(allow_float32: bool) -> None:
    """Raise `InputError` where JAX's double precision is off, unless that is allowed."""
    if not jax.config.jax_enable_x64 and not allow_float32:  # type: ignore[attr-defined]
        raise InputError(
            "single-precision",
            "JAX runs in single precision, in which fits stop early and errors come out wrong.",
            fix="hysid.enable_x64()",
        )
