"""The transform between bounded parameters and the unconstrained space of optimisers and samplers."""

from collections.abc import Mapping
from typing import Any, NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from hysteresis import AbstractModel, Record, parameters
from hysteresis._parameter import parameter_at

from .._levels import FACTOR
from ._settings import Prior, Setting, Settings

Model = TypeVar("Model", bound=eqx.Module)
Vector = TypeVar("Vector", Float[np.ndarray, " parameters"], Float[Array, " parameters"])
"""NumPy's arrays, which need no compilation, or JAX's."""

Vectors = TypeVar(
    "Vectors", Float[np.ndarray, "*draws parameters"], Float[Array, "*draws parameters"]
)
"""One vector or an array of them."""


class Transform(NamedTuple):
    """The map between the parameters of a model and an unconstrained vector z, one entry for each:

        no bounds       value = scale * z
        low < value     value = low + exp(z)
        value < high    value = high - exp(z)
        both            value = low + (high - low) / (1 + exp(-z))

    - `names`: the free parameters; the entries of an array are "E.0", "E.1".
    - `low`, `high`: their bounds. `scale`: of the unbounded ones, or one for all.
    - `priors`: of each. `ties`: (name, source, factor) of parameters that are multiples of another one.
    """

    names: tuple[str, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    scale: Float[np.ndarray, " parameters"] | float
    priors: tuple[Prior, ...] = ()
    ties: tuple[tuple[str, str, float], ...] = ()

    def to_free(self, model: eqx.Module) -> Float[np.ndarray, " parameters"]:
        """z of a model's current parameters."""
        return self.from_values(self.values(model))

    def from_values(
        self, x: Float[np.ndarray, "*draws parameters"]
    ) -> Float[np.ndarray, "*draws parameters"]:
        """The inverse of `to_values`."""
        low, high = np.array(self.low), np.array(self.high)
        has_low, has_high = np.isfinite(low), np.isfinite(high)
        with np.errstate(all="ignore"):
            both = np.log((x - low) / (high - x))
            one_sided = np.where(has_low, np.log(x - low), np.log(high - x))
        bounded = np.where(has_low & has_high, both, one_sided)
        return np.where(has_low | has_high, bounded, x / self.scale)

    def to_values(self, z: Vectors) -> Vectors:
        """The parameters of unconstrained vectors."""
        xp: Any = np if isinstance(z, np.ndarray) else jnp
        low, high = np.isfinite(self.low), np.isfinite(self.high)
        floor, ceiling = np.where(low, self.low, 0.0), np.where(high, self.high, 1.0)
        with np.errstate(over="ignore"):
            both = floor + (ceiling - floor) / (1 + xp.exp(-z))
            one_sided = xp.where(low, floor + xp.exp(z), ceiling - xp.exp(z))
        return xp.where(low & high, both, xp.where(low | high, one_sided, self.scale * z))

    def slope(self, z: Float[np.ndarray, " parameters"]) -> Float[np.ndarray, " parameters"]:
        """d value / d z, by which standard errors are converted."""
        h = 1e-6
        up, down = (self.to_values(z + d) for d in (h, -h))
        return (up - down) / (2 * h)

    def log_slope(self, z: Float[Array, " parameters"]) -> Float[Array, " parameters"]:
        """log |d value / d z|, exactly."""
        low, high = np.isfinite(self.low), np.isfinite(self.high)
        width = np.where(low & high, np.array(self.high) - np.array(self.low), 1.0)
        both = jnp.log(width) + jax.nn.log_sigmoid(z) + jax.nn.log_sigmoid(-z)
        return jnp.where(low & high, both, jnp.where(low | high, z, jnp.log(self.scale)))

    def log_prior(self, z: Float[Array, " parameters"]) -> Float[Array, ""]:
        """log of the prior density with respect to z."""
        values = self.to_values(z)
        terms = [prior.log_density(x) for prior, x in zip(self.priors, values, strict=True)]
        return jnp.sum(jnp.stack(terms) + self.log_slope(z))

    @property
    def asked(self) -> bool:
        """Whether the user specified any prior."""
        return not all(prior.default for prior in self.priors)

    @property
    def for_fit(self) -> "Transform":
        """The transform without its priors, unless the user specified some. Default priors depend on the
        record, and a program would be compiled anew for every one."""
        return self if self.asked else self._replace(priors=())

    def penalty(self, z: Float[Array, " parameters"]) -> Float[Array, ""]:
        """-log density of the user's priors up to a constant, see `Prior.penalty`."""
        asked = zip(self.priors, self.to_values(z), strict=bool(self.priors))
        terms = [prior.penalty(x) for prior, x in asked if not prior.default]
        return sum(terms, start=jnp.zeros((), z.dtype))

    def insert(self, model: Model, values: Vector) -> Model:
        """The model with these parameters."""
        found: dict[str, Any] = dict(zip(self.names, map(jnp.asarray, values), strict=True))
        found |= {name: f * found[source] for name, source, f in self.ties if source in found}
        whole: dict[str, Any] = {}
        for name, value in found.items():
            array, _, place = name.rpartition(".")
            if place.isdigit() and eqx.is_array(parameter_at(model, array)):
                places, entries = whole.setdefault(array, ([], []))
                places.append(int(place))
                entries.append(value)
            else:
                whole[name] = value
        for name, value in whole.items():
            if isinstance(value, tuple):
                places, entries = value
                array = parameter_at(model, name)
                whole[name] = array.at[np.array(places)].set(jnp.stack(entries))
        return eqx.tree_at(lambda m: [parameter_at(m, n) for n in whole], model, [*whole.values()])

    def model(self, template: Model, z: Vector) -> Model:
        """The model of a free vector; `template` has all that does not move."""
        return self.insert(template, self.to_values(z))

    def points_of(
        self, model: eqx.Module, *others: eqx.Module | None
    ) -> Float[np.ndarray, "points parameters"]:
        """The free vectors of a model, and of those others in which these parameters move too."""
        free = set(self.names)
        there = [other for other in others if other is not None]
        alike = [other for other in there if free <= set(transform(other, 1.0).names)]
        return np.stack([self.to_free(one) for one in (model, *alike)])

    def values(self, model: eqx.Module) -> Float[np.ndarray, " parameters"]:
        """The free parameters of a model."""
        return np.array([float(parameter_at(model, name)) for name in self.names])


def transform(
    model: eqx.Module,
    scale: float,
    input_scale: float = 1.0,
    settings: Settings | None = None,
    time_scale: float = 1.0,
    away: float = 0.0,
) -> Transform:
    """The transform of a model's free parameters: scalars and one-dimensional arrays inside their bounds.

    `scale` and `input_scale` are the sizes of output and input. They scale unbounded parameters and, with
    `time_scale`, the default priors. Offsets of a record that lies `away` of its ranges off zero are that
    much larger.
    """
    sizes = {"input": input_scale, "output / input": scale / input_scale, "1": 1.0}
    sizes["output"] = scale * (1 + away)
    of_words = {"input": input_scale, "output": scale, "time": time_scale}
    if isinstance(model, AbstractModel):
        words = model.unit_words("input", "output", "time")
        known = {word: of_words.get(meaning) for word, meaning in words.items()}
        # A condition has no size: its values are given, not fitted.
        of_words = {word: size for word, size in known.items() if size is not None}
    said, entries, ties = settings or {}, [], []
    for name, info, value in parameters(model):
        if value is None or np.ndim(value) > 1:
            continue
        for k in range(np.size(value)):
            number = name if np.ndim(value) == 0 else f"{name}.{k}"
            setting = said.get(number, Setting())
            bounds = setting.bounds or info.bounds
            # An entry on its bound stays there, and the others of its array move.
            inside = np.ndim(value) == 0 or bounds[0] < value[k] < bounds[1]
            if setting.tied is not None:
                ties.append((number, *setting.tied))
            elif inside and not (info.fixed or setting.fixed):
                size = data_scale(info.unit, of_words)
                if info.unit == "output" and not np.isfinite(bounds).any():
                    size *= 1 + away
                prior = setting.prior or default_prior(bounds, size)
                entries.append((number, bounds, sizes.get(info.unit, scale), prior))
    names = tuple(name for name, *_ in entries)
    low, high = (tuple(float(bounds[k]) for _, bounds, *_ in entries) for k in (0, 1))
    of_unbounded = np.array([size for *_, size, _ in entries])
    priors = tuple(prior for *_, prior in entries)
    return Transform(names, low, high, of_unbounded, priors, tuple(ties))


def transform_for(model: eqx.Module, record: Record, settings: Settings | None = None) -> Transform:
    """The transform of a model's free parameters on the scale of a record."""
    y, u = record.output[record.mask], record.input[record.mask]
    across = (
        float(np.ptp(u)) or float(np.max(np.abs(u))) or 1.0
    )  # the input of a creep test is constant
    time = 1.0
    if record.time is not None:
        steps = [np.diff(record.time[rows]) for _, rows in record.sequences()]
        step, span = np.median(np.concatenate(steps)), max(s.sum() for s in steps)
        time = float(np.sqrt(step * span)) or 1.0
    output = float(np.ptp(y))
    away = _off_zero(u) / across + (_off_zero(y) / output if output else 0.0)
    return transform(model, output, across, settings, time, away)


def _off_zero(values: Float[np.ndarray, " rows"]) -> float:
    """How far zero is from their range."""
    return max(float(values.min()), -float(values.max()), 0.0)


def default_prior(bounds: tuple[float, float], scale: float) -> Prior:
    """A weak prior about the data's scale.

    Log-normal within a factor of a thousand for a positive number, uniform between two bounds, else normal
    with ten times the scale.
    """
    low, high = bounds
    if np.isfinite(low) and np.isfinite(high):
        return Prior("uniform", low, high, default=True)
    if low == 0:
        return Prior("log-normal", scale, FACTOR, default=True)
    middle = low if np.isfinite(low) else high if np.isfinite(high) else 0.0
    return Prior("normal", middle, 10 * scale, default=True)


def data_scale(unit: str, sizes: Mapping[str, float]) -> float:
    """The size of a parameter, from its unit and the sizes of what the unit's words stand for.

    "force * time / displacement" -> sizes["force"] * sizes["time"] / sizes["displacement"].
    """
    scale, divide = 1.0, False
    for word in unit.split():
        if word in ("*", "/"):
            divide = word == "/"
            continue
        base, _, power = word.partition("^")
        size = sizes.get(base, 1.0) ** float(power or 1)
        scale, divide = (scale / size if divide else scale * size), False
    return scale
