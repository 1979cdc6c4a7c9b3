"""Sliders for a model's parameters in a notebook: what each does to the loop.

    from hysid import widgets
    widgets.sliders(fit.model, record)

Needs the extra `hysid[notebook]`.
"""

import importlib.util
import math
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from hysteresis import (
    AbstractModel,
    InputError,
    ParameterInfo,
    Record,
    parameter_at,
    parameters,
)
from identify import predict

from .figures import _base as f
from .figures import _format as words
from .figures._notebook import MOST_POINTS, _image
from .figures._plot import axes_of, path

MOST = 12
"""Sliders, at most."""
NEAR = 1e-3
"""How near to a bound a slider goes, as a part of the distance between both bounds."""


class Sliders:
    """A loop with a slider for each parameter; a notebook shows it.

    - `box`: the widget. `model`: the model as the sliders are now. `names`: the parameters that have one.
    """

    def __init__(self, model: AbstractModel, record: Record):
        widgets = _ipywidgets()
        self._record, self._start = record, model
        self.model: AbstractModel = model
        chosen = list(_scalars(model))[:MOST]
        self.names: tuple[str, ...] = tuple(name for name, _, _ in chosen)
        units = model.unit_words(record.input_unit, record.output_unit, record.time_unit)
        self._sliders = {
            name: _slider(widgets, name, info, value, units) for name, info, value in chosen
        }
        self._page = widgets.HTML()
        back = widgets.Button(description="as it was")
        back.on_click(lambda _: self.reset())
        self.box: Any = widgets.VBox([*self._sliders.values(), back, self._page])
        for slider in self._sliders.values():
            slider.observe(lambda _: self._draw(), names="value")
        self._draw()

    def set(self, name: str, value: float) -> None:
        """Move a slider. Raises `InputError` `unknown-parameter` where there is none of this name."""
        if name not in self._sliders:
            raise InputError(
                "unknown-parameter",
                f"There is no slider for {name!r}.",
                fix=f"There are {', '.join(self.names)}.",
            )
        self._sliders[name].value = value

    def reset(self) -> None:
        """Every parameter as it was given."""
        for name, slider in self._sliders.items():
            slider.value = float(parameter_at(self._start, name))

    def _draw(self) -> None:
        model = self._start
        for name, slider in self._sliders.items():
            old = parameter_at(self._start, name)
            if slider.value != float(old):
                value = jnp.asarray(slider.value, old.dtype)
                model = eqx.tree_at(lambda m, name=name: parameter_at(m, name), model, value)
        self.model, record = model, self._record
        modelled = np.asarray(predict(model, record))
        counted = record.mask & np.isfinite(record.output)
        error = float(np.sqrt(np.mean((modelled - record.output)[counted] ** 2)))
        curves = [
            f.Curve(
                "measured", *path(record, record.output, record.mask, MOST_POINTS), f.BLUE, "under"
            ),
            f.Curve("model", *path(record, modelled, record.mask, MOST_POINTS), f.VERMILLION),
        ]
        figure = f.chart(curves, *axes_of(record))
        said = f"rms error {words.quantity(error, record.output_unit)}"
        self._page.value = f"<p>{said}</p>{_image(figure, 'Measured loop and the model')}"

    def _repr_mimebundle_(self, **named: Any) -> Any:
        return self.box._repr_mimebundle_(**named)


def sliders(model: AbstractModel, record: Record) -> Sliders:
    """A slider for each scalar parameter of a model, fixed ones left out, that redraws its loop.

    A slider spans a factor of ten to either side of a positive value, else twice its size, and never
    leaves the parameter's bounds. The model given stays as it is; `.model` of the answer is new.

    Raises `InputError` `missing-extra` without ipywidgets.
    """
    return Sliders(model, record)


def _ipywidgets() -> Any:
    if importlib.util.find_spec("ipywidgets") is None:
        raise InputError(
            "missing-extra",
            "ipywidgets is not installed.",
            fix="Install it with pip install 'hysid[notebook]'.",
        )
    import ipywidgets

    return ipywidgets


def _scalars(model: AbstractModel) -> Any:
    for name, info, value in parameters(model):
        if value is not None and value.ndim == 0 and not info.fixed:
            yield name, info, float(value)


def _slider(
    widgets: Any, name: str, info: ParameterInfo, value: float, units: dict[str, str]
) -> Any:
    unit = words.pretty(info.in_units(units))
    shown = {
        "description": f"{name} ({unit})" if unit else name,
        "style": {"description_width": "14em"},
        "layout": {"width": "36em"},
        "continuous_update": False,
        "readout_format": ".4g",
    }
    low, high = info.bounds
    inside = NEAR * (high - low) if math.isfinite(high - low) else 0.0  # a bound itself is no value
    if value > 0 and low >= 0:
        low = min(max(value / 10, low + inside), value)
        high = max(min(value * 10, high - inside), value)
        ends = {"min": math.log10(low), "max": math.log10(high)}
        return widgets.FloatLogSlider(value=value, **ends, step=0.001, **shown)
    size = 2 * abs(value) or 1.0
    low = min(max(value - size, low + inside), value)
    high = max(min(value + size, high - inside), value)
    return widgets.FloatSlider(value=value, min=low, max=high, step=(high - low) / 500, **shown)
