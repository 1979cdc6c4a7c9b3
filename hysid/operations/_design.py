"""`hysid design`: which multisine would tell the hysteresis of a fitted oscillator best."""

import csv
from pathlib import Path
from typing import Any

import numpy as np

import identify
from hysteresis import InputError
from hysteresis._atomic_file import atomic_file, open_csv

EXCITATION = "excitation.csv"


def design(
    folder: Path,
    *,
    levels: str | None = None,
    bands: str | None = None,
    largest: float | None = None,
    rows: int | None = None,
    seed: int = 0,
) -> dict[str, Any]:
    """Rank multisines by `identify.design_excitation`, and write a period of the best one beside the fit.

    `levels`: "20,50"; `bands`: "5-150,20-80". The best one is the first that predicts within the fitted
    displacements, where there is one; `extrapolated` says that there is none.
    """
    fit = identify.load(folder)
    found = identify.design_excitation(
        fit,
        levels=None if levels is None else _numbers(levels, ",", "levels"),
        bands=None if bands is None else [_band(one) for one in bands.split(",")],
        rows=rows,
        largest=largest,
        seed=seed,
    )
    best = next((one for one in found if not one.beyond), found[0])
    assert isinstance(fit.detail, identify.Motion)
    record, dt, file = fit.train, fit.detail.recorded.dt, folder / EXCITATION
    lines = [(k * dt, float(force)) for k, force in enumerate(best.force)]
    with atomic_file(file) as new, open_csv(new) as handle:
        csv.writer(handle).writerows([(record.time_name, record.input_name), *lines])
    return {
        "multisines": [_entry(one) for one in found],
        "best": _entry(best),
        "extrapolated": best.beyond,
        "units": {"frequency": f"1 / {record.time_unit}", "level": record.input_unit,
                  "displacement": record.output_unit},
        "file": str(file),
    }  # fmt: skip


def _entry(one: identify.Excitation) -> dict[str, Any]:
    return {
        name: value if isinstance(value, bool) else float(value)
        for name, value in one._asdict().items()
        if name != "force"
    }


def _band(text: str) -> tuple[float, float]:
    ends = _numbers(text, "-", "bands")
    if len(ends) != 2:
        raise InputError(
            "bad-option", f"the band {text!r}.", fix="give low and high with - between, as 5-150."
        )
    return ends[0], ends[1]


def _numbers(text: str, between: str, option: str) -> list[float]:
    try:
        found = [float(one) for one in text.split(between)]
    except ValueError:
        found = [np.nan]
    if not np.isfinite(found).all():
        raise InputError("bad-option", f"{option} = {text!r} has a part that is not a number.")
    return found
