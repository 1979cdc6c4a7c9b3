"""Exported compensators: equal to JAX, how fast, how they bear what comes in a loop."""

import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from compensate import Status, export_c, export_runtime, invert
from compensate.runtime import load
from hysteresis import Preisach
from hysteresis.preisach import GridDensity
from tests.c_harness import COMPILERS, STRICT, Compiled

from .._measure import Row, judged, noted

CELLS = 100
NO_COMPILER = "no C compiler on this machine"

PROGRAM = """\
#define _POSIX_C_SOURCE 199309L
#include <stdio.h>
#include <stdlib.h>
#include <time.h>
#include "it.h"

static unsigned long long bits = 1;

static double uniform(void)
{
    bits = bits * 6364136223846793005ULL + 1442695040888963407ULL;
    return (double)(bits >> 11) / 9007199254740992.0;
}

static double now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return 1e9 * (double)t.tv_sec + (double)t.tv_nsec;
}

static int ascending(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* Median ns a step over blocks of a walk, forwards or backwards. */
static void timing(void)
{
    enum { BLOCKS = 400, STEPS = 2500 };
    static double u[STEPS], y[STEPS], forward[BLOCKS], backward[BLOCKS];
    double x = 0.5, sink = 0.0;
    it_state s, r;
    it_reset(&s);
    it_reset(&r);
    for (int b = 0; b < BLOCKS; ++b) {
        for (int k = 0; k < STEPS; ++k) {
            x += 0.03 * (uniform() - 0.5);
            x = x < 0.0 ? 0.0 : x > 1.0 ? 1.0 : x;
            u[k] = x;
        }
        double begin = now();
        for (int k = 0; k < STEPS; ++k) {
            y[k] = it_predict(&s, 0.01, u[k]);
        }
        forward[b] = (now() - begin) / STEPS;
        begin = now();
        for (int k = 0; k < STEPS; ++k) {
            double value;
            it_step(&r, 0.01, y[k], &value, 0);
            sink += value;
        }
        backward[b] = (now() - begin) / STEPS;
    }
    qsort(forward, BLOCKS, sizeof(double), ascending);
    qsort(backward, BLOCKS, sizeof(double), ascending);
    printf("%.9g %.9g %.9g\\n", forward[BLOCKS / 2], backward[BLOCKS / 2], sink);
}

/* After so many steps of noise: the difference to a fresh start that is led to the same state. */
static void soak(long steps)
{
    static const double path[] = {HIGH, LOW, 0.6, -0.5, 0.3, -0.1, 0.2};
    it_state s, fresh;
    double worst = 0.0, a, b;
    it_reset(&s);
    it_reset(&fresh);
    for (long k = 0; k < steps; ++k) {
        it_step(&s, 0.01, HIGH * (2.0 * uniform() - 1.0), &a, 0);
    }
    for (int k = 0; k < 7; ++k) {
        it_step(&s, 0.01, path[k], &a, 0);
        it_step(&fresh, 0.01, path[k], &b, 0);
        worst = fabs(a - b) > worst ? fabs(a - b) : worst;
    }
    printf("%.9g\\n", worst);
}

/* Anything at all: what comes back must be finite, and the status one of those there are. */
static void fuzz(long steps)
{
    it_state s;
    long wrong = 0;
    it_reset(&s);
    for (long k = 0; k < steps; ++k) {
        double x = uniform(), kind = 16.0 * uniform(), value;
        double y = kind < 1.0 ? (double)NAN : kind < 2.0 ? (double)INFINITY : kind < 3.0 ? 1e300 * (x - 0.5)
            : kind < 4.0 ? (x - 0.5) * 1e-300 : 4.0 * HIGH * (x - 0.5);
        int status = it_step(&s, 0.01, y, &value, 0);
        wrong += !isfinite(value) || status < IT_OK || status > IT_INVALID;
    }
    printf("%ld\\n", wrong);
}

/* One step, the costliest there is: it closes every loop and goes from end to end. */
static void worst(int step)
{
    it_state s;
    double value;
    it_reset(&s);
    for (int k = 0; k < 62; ++k) {
        it_step(&s, 0.01, (k % 2 ? -1.0 : 1.0) * HIGH * (1.0 - k / 64.0), &value, 0);
    }
    if (step) {
        it_step(&s, 0.01, HIGH, &value, 0);
    }
    printf("%.9g\\n", value);
}

int main(int count, char **words)
{
    long steps = count > 2 ? atol(words[2]) : 0;
    switch (words[1][0]) {
    case 't': timing(); break;
    case 's': soak(steps); break;
    case 'f': fuzz(steps); break;
    case 'w': worst((int)steps); break;
    default: return 1;
    }
    return 0;
}
"""


def relays() -> Preisach:
    """On a grid of 100 x 100, in saturation at +-1."""
    weights = np.tril(np.random.default_rng(0).random((CELLS, CELLS)))
    return Preisach(GridDensity(0.0, 1.0, weights / weights.sum()))


def noisy(samples: int) -> np.ndarray:
    """Slow swings of changing size, with noise of a hundredth."""
    k, random = np.arange(samples), np.random.default_rng(1)
    u = 0.5 + 0.4 * np.sin(k / 300) * np.cos(k / 7001) + 0.01 * random.normal(size=samples)
    return np.clip(u, 0.0, 1.0)


def exported_rows(quick: bool) -> list[Row]:
    """Every bar on what is exported, for the model of 100 x 100 relays."""
    model = relays()
    u = noisy(100_000 if quick else 1_000_000)
    y = np.asarray(model.simulate(None, u))
    value = np.asarray(invert(model).simulate(None, y).value)
    with tempfile.TemporaryDirectory() as folder:
        rows = _python(model, y, value, Path(folder))
        if COMPILERS:
            return rows + _c(model, y, value, Path(folder), quick)
        return [*rows, noted("the same in C", np.nan, reason=NO_COMPILER)]


def _python(model: Preisach, y: np.ndarray, value: np.ndarray, folder: Path) -> list[Row]:
    export_runtime(model, folder / "it.json", y, depth=128)
    compensator = load(folder / "it.json")
    readings, found, seconds = y.tolist(), [], []
    step, clock = compensator.step, time.perf_counter_ns
    for reading in readings:
        begin = clock()
        estimate = step(0.0, reading)
        seconds.append(clock() - begin)
        found.append(estimate.value)
    worst = np.abs(np.array(found) - value).max() / np.ptp(value)
    microseconds = np.array(seconds) / 1e3
    return [
        judged(f"Python against JAX, {len(y):,} noisy samples, of the range", worst, 1e-9),
        judged("Python, a step: median us", float(np.median(microseconds)), 4.0),
        judged(
            "Python, a step: 99.9th percentile, us", float(np.percentile(microseconds, 99.9)), 30.0
        ),
        judged("import compensate.runtime, ms", _import_milliseconds(), 60.0),
        _bad_samples(compensator, readings, found),
    ]


def _import_milliseconds() -> float:
    code = "import time; t = time.perf_counter(); import compensate.runtime, sys\n"
    code += "assert not {'jax', 'scipy'} & set(sys.modules); print(time.perf_counter() - t)"
    command = [sys.executable, "-c", code]
    taken = [float(subprocess.check_output(command, text=True)) for _ in range(7)]
    return 1e3 * float(np.median(taken))


def _bad_samples(compensator: Any, readings: list[float], found: list[float]) -> Row:
    """One in a hundred a bad one in between: the good ones' estimates do not change."""
    compensator.reset()
    random, changed = np.random.default_rng(2), 0
    bad = random.choice([np.nan, np.inf, -np.inf], len(readings)).tolist()
    hit = (random.random(len(readings)) < 0.01).tolist()
    for reading, wanted, spoilt, is_hit in zip(readings, found, bad, hit, strict=True):
        if is_hit:
            changed += compensator.step(0.01, spoilt).status is not Status.INVALID
        changed += compensator.step(0.01, reading).value != wanted
    return judged("estimates that NaN and infinities between the samples change", changed, 0)


def _c(model: Preisach, y: np.ndarray, value: np.ndarray, folder: Path, quick: bool) -> list[Row]:
    nothing = np.zeros(len(y))
    export_c(model, folder / "it.h", y, depth=128)
    double = np.abs(Compiled(folder / "it.h", COMPILERS[0]).run(nothing, y)[0] - value).max()
    export_c(model, folder / "single.h", y, depth=128, real="float")
    single = Compiled(folder / "single.h", COMPILERS[0]).run(nothing, y)[0]
    again = np.abs(np.asarray(model.simulate(None, single)) - y).max() / np.ptp(y)
    rounded = np.asarray(invert(model).simulate(None, y.astype(np.float32).astype(float)).value)
    export_c(model, folder / "single.h", y, real="float", depth=64)
    size = Compiled(folder / "single.h", COMPILERS[0]).size
    export_c(model, folder / "it.h", y, depth=64)
    ends = f"-DHIGH={float(y.max())!r}", f"-DLOW={float(y.min())!r}"
    (folder / "it_program.c").write_text(PROGRAM, "utf-8")
    plain = _compiled(folder, "plain", "-O2", *ends)
    forward, backward = (float(x) for x in _output(plain, "t").split()[:2])
    steps = 10**6 if quick else 10**8
    drift = float(_output(plain, "s", str(steps)))
    fuzzed = 10**5 if quick else 10**7
    checks = "-fsanitize=address,undefined", "-fno-sanitize-recover=all"
    wrong = float(_output(_compiled(folder, "checked", "-O1", *checks, *ends), "f", str(fuzzed)))
    what = f"{len(y):,} noisy samples, of the range"
    return [
        judged(f"C, double, against JAX, {what}", double / np.ptp(value), 1e-9),
        judged(f"C, float: what JAX makes of its estimates against {what}", again, 1e-4),
        # After a reversal the output grows with the square of the input.
        noted("    its estimates against JAX, at most, of the range", _share(single, value)),
        noted("    those of JAX from readings in float, likewise", _share(rounded, value)),
        noted(
            "    its estimates against JAX, 99 % are below, of the range", _share(single, value, 99)
        ),
        judged(f"C, {CELLS} x {CELLS}, a step back: median ns", backward, 120.0),
        judged(f"C, {CELLS} x {CELLS}, a step forward: median ns", forward, 20.0),
        _instructions(folder, ends),
        judged("C, float: bytes of state for 64 reversals", size, 1100),
        judged(f"C: drift after {steps:.0e} steps", drift, 1e-9),
        judged(f"C: faults in {fuzzed:.0e} fuzzed steps under sanitizers", wrong, 0),
    ]


def _share(found: np.ndarray, value: np.ndarray, percent: float = 100) -> float:
    return float(np.percentile(np.abs(found - value), percent) / np.ptp(value))


def _instructions(folder: Path, ends: tuple[str, ...]) -> Row:
    """Of the costliest step, beside the operations that the header states."""
    said = re.search(r"take more than ([\d,]+)", (folder / "it.h").read_text())
    assert said is not None
    stated = int(said[1].replace(",", ""))
    what = f"C: instructions of the costliest step, of the {stated:,} operations stated"
    program = _compiled(folder, "counted", "-O2", *ends)
    counts = []
    for step in ("0", "1"):
        try:
            done = subprocess.run(
                ["valgrind", "--tool=callgrind", "--callgrind-out-file=/dev/null", program, "w", step],
                capture_output=True, text=True,
            )  # fmt: skip
        except FileNotFoundError:
            return noted(what, np.nan, reason="no valgrind on this machine")
        (line,) = (x for x in done.stderr.splitlines() if "Collected" in x)
        counts.append(int(line.rsplit(":", 1)[1]))
    return judged(what, counts[1] - counts[0], stated)


def _compiled(folder: Path, name: str, *flags: str) -> str:
    program, strict = str(folder / name), [f for f in STRICT if f != "-Wconversion"]
    command = [COMPILERS[0], *strict, *flags, str(folder / "it_program.c"), "-o", program, "-lm"]
    subprocess.run(command, check=True)
    return program


def _output(program: str, *words: str) -> str:
    done = subprocess.run([program, *words], capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(done.stderr)
    return done.stdout
