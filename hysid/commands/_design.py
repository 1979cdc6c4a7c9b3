"""`hysid design`: which multisine would tell the hysteresis of a fitted oscillator best."""

from typing import Any

import identify
from hysteresis._files import write_table
from hysteresis._show import aligned
from identify.calibration._excitation_design import Excitation
from identify.results._detail import Motion

from ._asked import Design
from ._console import Done, warnings

EXCITATION = "excitation.csv"
SHOWN = 12
"""Multisines in the table."""


def run(asked: Design) -> Done:
    """Rank multisines by `identify.design_excitation`, and write a period of the best one beside the fit.

    The best one is the first that predicts within the fitted displacements, where there is one;
    `extrapolated` says that there is none.
    """
    fit = identify.load(asked.folder)
    found = identify.design_excitation(fit, largest=asked.max_displacement, seed=asked.seed)
    best = next((one for one in found if not one.beyond), found[0])
    assert isinstance(fit.detail, Motion)
    record, dt, file = fit.train, fit.detail.recorded.dt, asked.folder / EXCITATION
    lines = [(k * dt, float(force)) for k, force in enumerate(best.force)]
    write_table(file, (record.time_name, record.input_name), lines)
    document: dict[str, Any] = {
        "multisines": [_entry(one) for one in found],
        "best": _entry(best),
        "extrapolated": best.beyond,
        "units": {"frequency": f"1 / {record.time_unit}", "level": record.input_unit,
                  "displacement": record.output_unit},
        "file": str(file),
    }  # fmt: skip
    return Done(document, _lines(document))


def _lines(found: dict[str, Any]) -> list[str]:
    units, figures = found["units"], ("hysteresis", "mass", "damping", "stiffness")
    rows = [[
        f"band ({units['frequency']})", f"rms ({units['level']})", *figures,
        f"largest ({units['displacement']})", "",
    ]]  # fmt: skip
    rows += [
        [
            f"{one['low']:.4g}-{one['high']:.4g}", f"{one['level']:.4g}",
            *(f"{one[name]:.2%}" for name in figures), f"{one['displacement']:.3g}",
            "beyond the fitted record" if one["beyond"] else "",
        ]
        for one in found["multisines"][:SHOWN]
    ]  # fmt: skip
    lines = aligned(rows, range(7))
    if found["extrapolated"]:
        lines += warnings(
            ["Every multisine moves farther than the fitted record, so these figures extrapolate."]
        )
    return [*lines, found["file"]]


def _entry(one: Excitation) -> dict[str, Any]:
    return {
        name: value if isinstance(value, bool) else float(value)
        for name, value in one._asdict().items()
        if name != "force"
    }
