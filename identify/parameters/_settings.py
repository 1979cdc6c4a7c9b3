"""User settings of parameters: start value, bounds, prior, fixed, tied."""

import difflib
import re
from collections.abc import Mapping
from typing import Any, NamedTuple, TypedDict, TypeVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from hysteresis import InputError, parameters
from hysteresis._parameter import ParameterInfo, parameter_at

from ._priors import Prior, prior

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
