"""The step of an oscillator without JAX: a C99 header, and JSON for `compensate.runtime`."""

import re
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hysteresis import InputError, Oscillator
from hysteresis._atomic_file import write_whole
from hysteresis.dynamics._layout import Layout

from ..runtime._oscillator import KIND, OscillatorStep
from ._document import write
from ._oscillator_tree import exportable

SCHEMA = 1
AGREES = 1e-9
"""Part of the largest displacement by which a step may differ from the golden one."""

GOLDEN = 64


def export_oscillator(
    model: Oscillator, path: str | Path, dt: float, force: ArrayLike, *, title: str = ""
) -> Path:
    """Write the step of an oscillator: a C99 header where the path ends in .h, else JSON for the runtime.

    A step takes the force of a sample, straight since the one before, and gives the displacement, after
    `substeps` steps of Newmark's method of at most four Newton iterations each: bounded operations, no
    allocation. The first force is that of time 0, at rest.

    **Arguments:**

    - `dt`: time between two samples, which is fixed.
    - `force`: (samples,) a typical force; its first samples and their displacements are kept in the file,
      which is checked against them.

    Raises `InputError` `not-exportable` where the hysteresis is not of one part in rate form at most and
    plays, or where another integration than Newmark's with a straight force is chosen.

    **Example:**

        >>> spring = hysteresis.BoucWenForce(alpha=5e4, beta_gamma=800.0)
        >>> plant = hysteresis.Oscillator(2.0, 10.0, 5e4, spring)
        >>> file = compensate.export_oscillator(plant, folder / "mount.json", 1 / 750, np.ones(64))
        >>> step = compensate.runtime.load_oscillator(file).step
        >>> [round(1e6 * step(40.0), 1) for _ in range(3)]
        [0.0, 17.6, 68.7]
    """
    layout = exportable(model)
    if not dt > 0:
        raise InputError("bad-option", f"dt={dt}; a time above 0.")
    document = _document(model, layout, float(dt), np.asarray(force, float)[:GOLDEN], title)
    path = Path(path)
    if path.suffix == ".h":
        write_whole(path, _header(document, path.stem))
        return path
    return write(path, document)


def _document(
    model: Oscillator, layout: Layout, dt: float, force: np.ndarray, title: str
) -> dict[str, Any]:
    document: dict[str, Any] = {
        "schema": SCHEMA,
        "kind": KIND,
        "title": title,
        "dt": dt,
        "substeps": model.substeps,
        "mass": float(model.mass),
        "damping": float(model.damping),
        "stiffness": float(model.stiffness),
        "rate": layout.rate.tolist(),
        "limit": layout.limit,
        "radii": layout.radii.tolist(),
        "reach": layout.reach.tolist(),
        "counts": layout.counts.tolist(),
        "heights": layout.heights.tolist(),
    }
    found = model.displacement(dt * np.arange(len(force)), force)
    size = float(np.abs(found).max(initial=0.0))
    golden = {"force": force.tolist(), "displacement": found.tolist()}
    document["golden"] = golden | {"tolerance": AGREES * size + 1e-300}
    OscillatorStep(document)  # as it will be read
    return document


def _header(document: dict[str, Any], stem: str) -> str:
    name = re.sub(r"\W", "_", stem)
    name = name if name[0].isalpha() else f"o_{name}"
    rate, golden = document["rate"], document["golden"]
    knots, plays = len(rate[0]), len(document["radii"])
    counts = document["counts"]
    first = np.concatenate([[0], np.cumsum(counts)]).astype(int).tolist()
    per = [(n - 1) / (2 * r) for n, r in zip(counts, document["reach"], strict=True)]
    slopes = [
        [(b - a) * (knots - 1) / (2 * document["limit"]) for a, b in pairwise(f)] for f in rate
    ]
    words = {
        "name": name,
        "guard": f"{name.upper()}_H",
        "title": re.sub(r"[^\x20-\x7e]|\*/", "?", document["title"] or "an oscillator"),
        "knots": knots,
        "plays": plays,
        "substeps": document["substeps"],
        "count": len(golden["force"]),
        "step": _real(document["dt"] / document["substeps"]),
        "dt": _real(document["dt"]),
        **{key: _real(document[key]) for key in ("mass", "damping", "stiffness", "limit")},
        "z_per": _real((knots - 1) / (2 * document["limit"]) if knots else 0.0),
        "tolerance": _real(golden["tolerance"]),
        "force": _array(golden["force"]),
        "displacement": _array(golden["displacement"]),
    }
    tables = []
    if knots:
        tables.append(_table(name, "f", 2 * knots, [x for f in rate for x in f]))
        tables.append(_table(name, "df", 2 * (knots - 1), [x for f in slopes for x in f]))
    if plays:
        ends = [-x for x in document["reach"]]
        tables += [
            _table(name, key, plays, values)
            for key, values in (("radius", document["radii"]), ("low", ends), ("per", per))
        ]
        listed = ", ".join(map(str, first))
        tables.append(f"static const int {name}_first[{plays + 1}] = {{{listed}}};")
        tables.append(_table(name, "height", len(document["heights"]), document["heights"]))
    words["tables"] = "\n".join(tables)
    words["rate_before"] = _RATE_BEFORE.format(**words) if knots else ""
    words["rate_within"] = _RATE_WITHIN.format(**words) if knots else ""
    words["plays_within"] = _PLAYS_WITHIN.format(**words) if plays else ""
    words["plays_after"] = _PLAYS_AFTER.format(**words) if plays else ""
    words["field"] = f"    double play[{plays}];\n" if plays else ""
    words["clear"] = (
        f"    for (int j = 0; j < {plays}; ++j) {{ s->play[j] = 0.0; }}\n" if plays else ""
    )
    words["at_rest"] = _AT_REST.format(**words) if plays else ""
    words["local"] = f"        double play[{plays}];\n" if plays else ""
    words["z_local"] = "        double z1 = s->z;\n" if knots else ""
    words["z_sum"] = "z1" if knots else "0.0"
    words["z_keep"] = "        s->z = z1;\n" if knots else ""
    words["by_rate"] = " + damp * half * f1" if knots else ""
    return _HEADER.format(**words)


def _real(value: float) -> str:
    return repr(float(value))


def _array(values: list[float]) -> str:
    return ", ".join(map(_real, values))


def _table(name: str, key: str, count: int, values: list[float]) -> str:
    return f"static const double {name}_{key}[{count}] = {{{_array(values)}}};"


_RATE_BEFORE = """\
        const int side0 = s->v < 0.0 ? {knots} : 0;
        double f0;
        {{
            const double place = (s->z + {limit}) * {z_per};
            int cell = (int)(place < 0.0 ? 0.0 : place > {knots} - 2.0 ? {knots} - 2.0 : place);
            f0 = {name}_f[side0 + cell]
                + ({name}_f[side0 + cell + 1] - {name}_f[side0 + cell]) * (place - cell);
        }}
        const double z0 = s->z + half * s->v * f0;
"""

_RATE_WITHIN = """\
            const int side1 = v1 < 0.0 ? {knots} : 0, slope1 = v1 < 0.0 ? {knots} - 1 : 0;
            double f1 = 0.0, damp = 1.0;
            for (int inner = 0; inner < 2; ++inner) {{
                const double place = (z1 + {limit}) * {z_per};
                int cell = (int)(place < 0.0 ? 0.0 : place > {knots} - 2.0 ? {knots} - 2.0 : place);
                const double df = {name}_df[slope1 + cell];
                f1 = {name}_f[side1 + cell]
                    + ({name}_f[side1 + cell + 1] - {name}_f[side1 + cell]) * (place - cell);
                damp = 1.0 / (1.0 - half * v1 * df);
                const double off = (z1 - z0 - half * v1 * f1) * damp;
                z1 -= off;
                f1 -= off * df;
            }}
"""

_PLAYS_WITHIN = """\
            for (int j = 0; j < {plays}; ++j) {{
                const double high = y1 + {name}_radius[j], low = y1 - {name}_radius[j];
                double p = s->play[j];
                int moves = {name}_radius[j] == 0.0;
                if (p > high) {{ p = high; moves = 1; }}
                if (p < low) {{ p = low; moves = 1; }}
                play[j] = p;
                const double place = (p - {name}_low[j]) * {name}_per[j];
                const double last = {name}_first[j + 1] - {name}_first[j] - 2;
                const int cell = (int)(place < 0.0 ? 0.0 : place > last ? last : place);
                const double *at = {name}_height + {name}_first[j] + cell;
                total += at[0] + (at[1] - at[0]) * (place - cell);
                if (moves) {{ stretch += (at[1] - at[0]) * {name}_per[j]; }}
            }}
"""

_PLAYS_AFTER = "        for (int j = 0; j < {plays}; ++j) {{ s->play[j] = play[j]; }}\n"

_AT_REST = """\
        for (int j = 0; j < {plays}; ++j) {{
            const double place = (0.0 - {name}_low[j]) * {name}_per[j];
            const double last = {name}_first[j + 1] - {name}_first[j] - 2;
            const int cell = (int)(place < 0.0 ? 0.0 : place > last ? last : place);
            const double *at = {name}_height + {name}_first[j] + cell;
            rest += at[0] + (at[1] - at[0]) * (place - cell);
        }}
"""

_HEADER = """\
/* {title}: the displacement of a mass on a spring, a damper and a hysteretic force.
 *
 * One step a sample of {dt}, in {substeps} steps of Newmark's method: bounded operations, no allocation, no
 * recursion, no library. {name}_step takes the force of the sample, straight since the one before, and
 * gives the displacement. The first force is that of time 0, at rest. {name}_self_test gives 0 where the
 * golden displacements come again.
 */
#ifndef {guard}
#define {guard}

{tables}

typedef struct {{
    double y, v, a, z, force;
{field}    int begun;
}} {name}_state;

static inline void {name}_reset({name}_state *s)
{{
    s->y = s->v = s->a = s->z = s->force = 0.0;
{clear}    s->begun = 0;
}}

static inline double {name}_step({name}_state *s, double force)
{{
    const double h = {step}, half = 0.5 * h, quarter = 0.25 * h * h;
    if (!s->begun) {{
        double rest = 0.0;
{at_rest}        s->a = (force - rest) / {mass};
        s->force = force;
        s->begun = 1;
        return s->y;
    }}
    const double rise = (force - s->force) / {substeps}.0;
    for (int k = 1; k <= {substeps}; ++k) {{
        const double push = k == {substeps} ? force : s->force + rise * k;
        double a1 = s->a, y1 = 0.0, v1 = 0.0;
{local}{z_local}{rate_before}        for (int turn = 0; turn < 4; ++turn) {{
            y1 = s->y + h * s->v + quarter * (s->a + a1);
            v1 = s->v + half * (s->a + a1);
{rate_within}            double total = {z_sum}, stretch = 0.0;
{plays_within}            const double off = {mass} * a1 + {damping} * v1 + {stiffness} * y1 + total - push;
            const double change =
                off / ({mass} + half * ({damping}{by_rate}) + quarter * ({stiffness} + stretch));
            a1 -= change;
            if (change * change < 1e-24 * a1 * a1) {{ break; }}
        }}
        y1 = s->y + h * s->v + quarter * (s->a + a1);
        v1 = s->v + half * (s->a + a1);
        s->y = y1;
        s->v = v1;
        s->a = a1;
{z_keep}{plays_after}    }}
    s->force = force;
    return s->y;
}}

static inline int {name}_self_test({name}_state *s)
{{
    static const double forces[{count}] = {{{force}}};
    static const double wanted[{count}] = {{{displacement}}};
    int wrong = 0;
    {name}_reset(s);
    for (int k = 0; k < {count}; ++k) {{
        const double off = {name}_step(s, forces[k]) - wanted[k];
        wrong += !(off <= {tolerance} && -off <= {tolerance});
    }}
    {name}_reset(s);
    return wrong;
}}

#endif
"""
