"""Hostile names through every language, and headers fed with numbers that no sensor gives."""

import json
import shutil
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

import jinja2
import numpy as np

from compensate import Quantity, export_c, export_to
from compensate.export._export import Origin
from hysid.reporting._report import _visible
from hysteresis import LinearSponge, Preisach
from hysteresis._escape import c_comment, c_string, json_text, markup, toml_comment, toml_string
from hysteresis.preisach import GridDensity
from tests.c_harness import COMPILERS, STRICT, Compiled
from tests.problems import INVERTIBLE, Problem, random_histories
from tests.test_compensate.test_runtime import hostile
from tests.test_hysteresis.test_escape import HOSTILE, Tags, names, stripped

from .._measure import Row, judged, noted
from .fuzzing import elsewhere, fuzz

SANITIZERS = ("-O1", "-g", "-fsanitize=undefined", "-fno-sanitize-recover=all")
ROWS = 60
FIXED, FIXED_STEPS = 5, 1_000_000
"""Grids in fixed point, and steps of each."""

FIXED_LOOP = """
#include <math.h>
#include "sensor.h"
static const float odd[] = {NAN, INFINITY, -INFINITY, 3e38f, -3e38f, 1e12f, -1e12f, 0.0f};
static const int32_t ends[] = {INT32_MIN, -INT32_MAX, INT32_MAX, -65536, 65536, -1, 0, 1};
int main(void)
{
    uint64_t seed = 1;
    int32_t u, off;
    sensor_state s;
    sensor_reset(&s);
    for (long k = 0; k < %dL; ++k) {
        seed = seed * 6364136223846793005ULL + 1442695040888963407ULL;
        uint32_t at = (uint32_t)(seed >> 32);
        int32_t reading = (int32_t)(at & 0x1fffffffu) - 0x10000000;
        reading = at >> 31 ? reading : at >> 30 & 1 ? ends[at & 7] : sensor_reading(odd[at & 7]);
        int status = sensor_step(&s, 0, reading, &u, &off);
        if (u < 0 || u >= (int32_t)SENSOR_CELLS << 16) { return 1; }
        if ((status == SENSOR_INVALID) != (reading == SENSOR_UNKNOWN)) { return 2; }
    }
    return sensor_self_test(&s);
}
"""


def hostile_names(count: int) -> list[Row]:
    """Each name in C, C++, HTML, SVG, JSON and TOML; whole headers of each by compilers."""

    def tried(name: str) -> str:
        assert stripped(f"x/* {c_comment(name)} */y") == "xy"
        assert c_string(name).isascii()
        page = Tags()
        template = jinja2.Environment(autoescape=True, finalize=_visible).from_string(
            "<p>{{ it }}</p>"
        )
        page.feed(template.render(it=name) + f"<text>{markup(name)}</text>")
        page.close()
        assert page.tags == ["p", "text"]
        line = f"# {toml_comment(name)}\nname = {toml_string(name)}\n"
        assert set(tomllib.loads(line.encode().decode())) == {"name"}
        assert json.loads(json_text(json.dumps(name, ensure_ascii=False)).encode()) == name
        return "read"

    with elsewhere():
        rows = fuzz(names, count, tried).rows("hostile names through C, HTML, SVG, JSON, TOML")[:1]
    compilers = [[c, "-std=c99"] for c in COMPILERS]
    compilers += [["g++", "-std=c++11", "-trigraphs", "-x", "c++"]] if shutil.which("g++") else []
    if not compilers:
        return [
            *rows,
            noted("headers with hostile names", 0, reason="needs a C compiler: gcc or clang"),
        ]
    wrong, tried_names = 0, HOSTILE[: max(count // 10, 5)]
    model, u = LinearSponge(0.4, 0.0), np.linspace(0.0, 10.0, 20)
    with tempfile.TemporaryDirectory() as place:
        for k, name in enumerate(tried_names):
            quantity = Quantity(name, name[::-1])
            export_c(
                model, Path(place) / f"h{k}.h", model.simulate(None, u), reading=quantity,
                estimate=quantity, title=name, origin=Origin("PASS", (name,), name),
            )  # fmt: skip
        source = "".join(f'#include "h{k}.h"\n' for k in range(len(tried_names)))
        (Path(place) / "all.c").write_text(f"{source}int main(void) {{ return 0; }}\n")
        strict = [
            "-Wall",
            "-Wextra",
            "-Werror",
            "-Wno-unused-function",
            "all.c",
            "-o",
            "all",
            "-lm",
        ]
        for compiler in compilers:
            built = subprocess.run([*compiler, *strict], cwd=place, capture_output=True)
            clean = built.returncode == 0
            wrong += not clean or subprocess.run([Path(place) / "all"], cwd=place).returncode != 0
    what = f"headers of {len(tried_names)} hostile names by {len(compilers)} compilers: not clean"
    return [*rows, judged(what, wrong, 0)]


def headers(every: int) -> list[Row]:
    """Every exportable model, double and float: NaN, inf, 1e308, clocks of any size, then good samples."""
    if not COMPILERS:
        return [
            noted("headers fed with broken numbers", 0, reason="needs a C compiler: gcc or clang")
        ]
    problems = INVERTIBLE[::every]
    wrong = [
        f"{p.name}, {real}" for p in problems for real in ("double", "float") if not _sound(p, real)
    ]
    what = f"headers of {len(problems)} models, double and float, fed with {ROWS} broken samples: not sound"
    rows = [judged(f"{what} {', '.join(wrong[:3])}".rstrip(), len(wrong), 0)]
    grids = range(FIXED)[::every]
    wraps = sum(not _saturates(seed) for seed in grids)
    what = f"grids in fixed point, {FIXED_STEPS:,} integers of each under sanitizers: that wrap, of"
    return [*rows, judged(f"{what} {len(grids)}", wraps, 0)]


def _saturates(seed: int) -> bool:
    """A grid at random, as a header in Q16.16: estimates stay on it, and no sum leaves its 32 bits."""
    random = np.random.default_rng(seed)
    cells = int(random.integers(2, 121))
    masses = np.tril(random.lognormal(0.0, random.uniform(0.0, 2.0), (cells, cells)))
    low, width = random.normal(0.0, 100.0), random.lognormal(0.0, 3.0)
    share = random.uniform(0.1, 3.0) / cells
    model = Preisach(
        GridDensity(low, low + width, masses / masses.sum()), share * random.random(cells)
    )
    u = random_histories(random, low, low + width, (1, 300))[0]
    with tempfile.TemporaryDirectory() as place:
        made = export_to(
            "arduino", model, Path(place, "sensor"), model.simulate(None, u), real="fixed"
        )
        code = Path(made.path, "src", "loop.c")
        code.write_text(FIXED_LOOP % FIXED_STEPS, "utf-8")
        command = [
            COMPILERS[0],
            *STRICT,
            *SANITIZERS,
            str(code),
            "-o",
            str(Path(place, "loop")),
            "-lm",
        ]
        subprocess.run(command, check=True)
        done = subprocess.run([Path(place, "loop")], capture_output=True, text=True, check=False)
    if done.returncode:
        print(f"grid {seed}: exit {done.returncode} {done.stderr[:300]}", file=sys.stderr)
    return done.returncode == 0


def _sound(problem: Problem, real: str) -> bool:
    """Estimates and predictions finite throughout, and the good samples of exact models right again."""
    model = problem.model()
    u = random_histories(np.random.default_rng(0), problem.low, problem.high, (1, 200))[0]
    t = np.cumsum(np.full(200, 0.01))
    y = np.asarray(model.simulate(t, u))
    broken, clock = hostile(ROWS)
    with tempfile.TemporaryDirectory() as place:
        path = Path(place) / "it.h"
        export_c(model, path, y, times=t, depth=256, real=real)
        it = Compiled(path, COMPILERS[0], SANITIZERS)
        value, status = it.run(np.append(clock, np.full(200, 0.01)), np.append(broken, y))
        back = it.predict(np.append(clock, np.full(200, 0.01)), np.append(broken, u))
        again, _ = it.run(np.full(200, 0.01), y)
    limit = float(np.finfo("f8" if real == "double" else "f4").max)
    fed = np.abs(np.append(broken, u)) <= limit
    finite = np.isfinite(value[1:]).all() and np.isfinite(again).all() and bool(status.size)
    return bool(finite and np.isfinite(back[fed]).all())
