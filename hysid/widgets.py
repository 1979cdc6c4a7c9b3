"""Sliders for a model's parameters in a notebook: what each does to the loop.

    from hysid import widgets
    widgets.sliders(fit.model, record)

Needs the extra `hysid[notebook]`.
"""

import importlib.util
import math
from typing import Any

import numpy as np

from hysteresis import AbstractModel, InputError, Record, parameter_at
from identify import predict

from .figures import _base as f
from .figures import _format as words
from .figures._notebook import MOST_POINTS, _image
from .figures._plot import axes_of, path
from .figures._sliders import Slider, moved, sliders_of


class Sliders:
    """A loop with a slider for each parameter; a notebook shows it.

    - `box`: the widget. `model`: the model as the sliders are now. `names`: the parameters that have one.
    """

    def __init__(self, model: AbstractModel, record: Record):
        widgets = _ipywidgets()
        self._record, self._start = record, model
        self.model: AbstractModel = model
        units = model.unit_words(record.input_unit, record.output_unit, record.time_unit)
        chosen = sliders_of(model, units)
        self.names: tuple[str, ...] = tuple(one.name for one in chosen)
        self._sliders = {one.name: _slider(widgets, one) for one in chosen}
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
        model = moved(self._start, {name: one.value for name, one in self._sliders.items()})
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


def _slider(widgets: Any, one: Slider) -> Any:
    unit = words.pretty(one.unit)
    shown = {
        "description": f"{one.name} ({unit})" if unit else one.name,
        "style": {"description_width": "14em"},
        "layout": {"width": "36em"},
        "continuous_update": False,
        "readout_format": ".4g",
    }
    if one.logarithmic:
        ends = {"min": math.log10(one.low), "max": math.log10(one.high)}
        return widgets.FloatLogSlider(value=one.value, **ends, step=0.001, **shown)
    ends = {"min": one.low, "max": one.high, "step": (one.high - one.low) / 500}
    return widgets.FloatSlider(value=one.value, **ends, **shown)
