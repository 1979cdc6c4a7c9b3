"""Hostile names through every language, and headers fed with numbers that no sensor gives."""

import json
import shutil
import subprocess
import tempfile
import tomllib
from pathlib import Path

import jinja2
import numpy as np

from compensate import Origin, Quantity, export_c
from hysid.reporting._fit_page import _visible
from hysteresis import LinearSponge
from hysteresis._escape import c_comment, c_string, json_text, markup, toml_comment, toml_string
from tests.c_harness import COMPILERS, Compiled
from tests.problems import Problem, random_histories
from tests.test_compensate.test_runtime import EXPORTED
from tests.test_compensate.test_runtime_hostile import hostile
from tests.test_hysteresis.test_escape import HOSTILE, Tags, names, stripped

from .._measure import Row, judged, noted
from .fuzzing import elsewhere, fuzz

SANITIZERS = ("-O1", "-g", "-fsanitize=undefined", "-fno-sanitize-recover=all")
ROWS = 60


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
    problems = EXPORTED[::every]
    wrong = [
        f"{p.name}, {real}" for p in problems for real in ("double", "float") if not _sound(p, real)
    ]
    what = f"headers of {len(problems)} models, double and float, fed with {ROWS} broken samples: not sound"
    return [judged(f"{what} {', '.join(wrong[:3])}".rstrip(), len(wrong), 0)]


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
