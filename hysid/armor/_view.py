"""`hysid armor view`: one page that replays touches, and needs nothing else."""

import json
from importlib.resources import files
from pathlib import Path
from typing import Any

import jinja2
import numpy as np
import scipy

from hysteresis._atomic_file import write_whole

from ._touches import read_touches

PAGE = "armor.html"
PROBABILITY = 0.9
MEANINGS = {
    "OK": "One surface is touched, and here.",
    "NO_CONTACT": "Nothing pushes.",
    "BELOW_THRESHOLD": "Pushed too softly to say where.",
    "PULLING": "The force pulls, which no contact can do.",
    "MISSED": "The line of action passes every surface by.",
    "AMBIGUOUS": "The line of action meets more than one surface; this is the likeliest.",
    "INVALID": "A channel of the sensor gave no number.",
    "SATURATED": "A channel of the sensor stood at its end: the point is off.",
    "EXTRAPOLATED": "Pushed harder than the cover was ever measured.",
    "SECOND_SUPPORT": "Too much spin torque for one contact: something else bears on the shell.",
}


def view(folder: Path) -> dict[str, Any]:
    """Write DIR/armor.html from DIR/touches.json. Raises `InputError` where that is not whole."""
    record = read_touches(folder)
    record["axes"] = _half_axes(record.pop("covariance", None))
    record["meanings"] = MEANINGS
    source = files("hysid.armor")
    page = jinja2.Environment(autoescape=True).from_string(
        (source / "armor_view.html.j2").read_text("utf-8")
    )
    # "<" could end the script that holds the data.
    data = json.dumps(record, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
    html = page.render(
        title=record["title"],
        record=data,
        script=(source / "armor_view.js").read_text("utf-8"),
        has_axes=record["axes"] is not None,
    )
    target = folder / PAGE
    write_whole(target, html)
    return {"file": str(target), "rows": len(record["time"])}


def _half_axes(covariance: list[Any] | None) -> list[Any] | None:
    """Half axes, longest first, of the ellipsoids that hold a normal point with `PROBABILITY`, in m."""
    if covariance is None:
        return None
    reach = np.sqrt(scipy.stats.chi2.ppf(PROBABILITY, 3))
    axes: list[Any] = []
    for matrix in covariance:
        if matrix is None:
            axes.append(None)
            continue
        variance, direction = np.linalg.eigh(np.array(matrix))
        half = reach * np.sqrt(np.maximum(variance, 0)) * direction
        axes.append(half.T[::-1].round(7).tolist())
    return axes
