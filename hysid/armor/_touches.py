"""touches.json: a shell and a record of touches on it, which `hysid armor view` replays.

schema       1
title        of the page
vertices     (n, 3) m, corners of the shell, from P_o
triangles    (m, 3) numbers of vertices, from 0
time         (t,) s
force        (t, 3) N, exerted by the load        moment  (t, 3) N m about P_o
point        (t, 3) m, P^e; null without contact   surface (t,) from 1; 0 for none
displacement (t,) m        spin (t,) N m           status  (t,) a word
covariance   (t, 3, 3) m2 of the point, or left out
"""

import json
import math
from importlib.resources import files
from pathlib import Path
from typing import Any

import jinja2
import numpy as np
import scipy
from jaxtyping import Float, Int

import identify
from compensate.armor import ContactStatus, Mesh
from compensate.armor._solver import Contact
from hysteresis import InputError
from hysteresis._files import write_whole
from hysteresis._limits import damage_told, parse_json

FILE = "touches.json"
COLUMNS = {
    "vertices": (3,), "triangles": (3,), "time": (), "surface": (), "force": (3,), "moment": (3,),
    "point": (3,), "displacement": (), "spin": (), "covariance": (3, 3),
}  # fmt: skip
"""Numbers, and the shape of each row."""
MOST = 20_000
"""Rows that a page replays: of more, every k-th."""

Shell = tuple[Float[np.ndarray, "vertices 3"], Int[np.ndarray, "triangles 3"]]


def shell_of(shape: Any) -> Shell:
    """Corners and triangles of a `Box` or a `Mesh`, counter-clockwise seen from outside, to draw it."""
    if isinstance(shape, Mesh):
        triangles = np.asarray(shape.corners())
    else:
        a, b = np.moveaxis(np.asarray(shape.axes()), 1, 0)
        way = np.sign(np.sum(np.cross(a, b) * np.asarray(shape.faces().normal), axis=1))
        a = -way[:, None] * a
        sides = np.stack([-a - b, a - b, a + b, b - a], axis=1)
        square = np.asarray(shape.centres())[:, None] + sides
        triangles = np.concatenate([square[:, [0, 1, 2]], square[:, [0, 2, 3]]])
    # By so many digits corners of neighbours are known to be one.
    digits = 6 - math.floor(math.log10(float(shape.longest())))
    corners = triangles.reshape(-1, 3).round(digits)
    vertices, number = np.unique(corners, axis=0, return_inverse=True)
    return vertices, number.reshape(-1, 3)


VIRTUAL = " (virtual: synthetic readings of a virtual rig, no measurement)"
"""Behind the title of touches that nobody measured."""


def save_touches(
    folder: Path,
    shell: Shell,
    time: Float[np.ndarray, " times"],
    force: Float[np.ndarray, "times 3"],
    moment: Float[np.ndarray, "times 3"],
    contact: Contact,
    *,
    title: str = "Touches",
    covariance: Float[np.ndarray, "times 3 3"] | None = None,
) -> Path:
    """Write what a solver found in a record of wrenches; rows stand for times that are no clock."""
    if not np.all(np.diff(time) >= 0):
        time = np.arange(float(len(time)))
    some = slice(None, None, -(-len(time) // MOST))
    status = [ContactStatus(int(s)).name for s in np.asarray(contact.status)[some]]
    surface = np.asarray(contact.surface)
    point = np.where(surface[:, None] > 0, np.asarray(contact.point), np.nan)
    columns = {
        "force": force, "moment": moment, "point": point, "displacement": contact.displacement,
        "spin": contact.spin, "covariance": covariance,
    }  # fmt: skip
    document = {"schema": 1, "title": title, "vertices": shell[0], "triangles": shell[1]}
    document |= {"time": time[some], "surface": surface[some], "status": status}
    document |= {k: _rounded(np.asarray(x)[some]) for k, x in columns.items() if x is not None}
    file = folder / FILE
    write_whole(file, json.dumps(identify.internal.plain(document), separators=(",", ":")) + "\n")
    return file


def read_touches(folder: Path) -> dict[str, Any]:
    """The document, once it is known to be whole. Raises `InputError` where it is not."""
    file = folder / FILE
    if not file.is_file():
        raise InputError(
            "file-not-found", f"This folder has no {FILE}.", place=str(folder),
            fix="Name a folder that hysid armor solve wrote.",
        )  # fmt: skip
    with damage_told(FILE, file, "Write it again: hysid armor solve --overwrite."):
        document = parse_json(file.read_bytes())
        if document["schema"] != 1:
            raise ValueError(f"its schema is {document['schema']}, and this hysid knows 1")
        _check(document)
    return document


def _check(document: dict[str, Any]) -> None:
    count = len(document["time"])
    if not 0 < count <= MOST:
        raise ValueError(f"{count} rows, where 1 to {MOST} can be replayed")
    if unknown := document.keys() - {"schema", "title", "status", *COLUMNS}:
        raise ValueError(f"{min(unknown)} is unknown")
    for name, shape in COLUMNS.items():
        if name == "covariance" and name not in document:
            continue
        rows = [np.full(shape, np.nan) if row is None else row for row in document[name]]
        found = np.array(rows)  # null is NaN
        own = found.shape[:1] if name in ("vertices", "triangles") else (count,)
        if found.dtype.kind not in "if" or found.shape != (*own, *shape):
            raise ValueError(f"{name} is not {(*own, *shape)} numbers")
    corners, triangles = np.array(document["vertices"], float), np.array(document["triangles"])
    whole = np.append(triangles.ravel(), document["surface"])
    if whole.dtype.kind != "i" or not np.isin(triangles, np.arange(len(corners))).all():
        raise ValueError("a triangle names a corner that is not there")
    words = [document["title"], *document["status"]]
    if len(words) != 1 + count or not all(isinstance(word, str) for word in words):
        raise ValueError("title and status are words")
    times = np.array(document["time"], float)
    if not (
        np.isfinite(times).all() and np.isfinite(corners).all() and np.all(np.diff(times) >= 0)
    ):
        raise ValueError("time runs back")


def _rounded(values: np.ndarray) -> Any:
    """Five digits, a hundredth of a millimetre of a metre; null for a row that is not finite."""
    five = np.vectorize(lambda x: float(f"{x:.5g}"), otypes=[float])
    return [five(row).tolist() if np.isfinite(row).all() else None for row in values]


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


def replay(folder: Path) -> dict[str, Any]:
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
