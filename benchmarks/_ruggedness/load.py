"""Much of everything: rows, columns, groups, steps in C, threads and processes at once."""

import multiprocessing
import resource
import shutil
import subprocess
import sys
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from functools import partial
from itertools import islice
from pathlib import Path

import numpy as np

import identify
from compensate import adaptive, export_c, invert
from hysteresis import Record
from tests.c_harness import STRICT
from tests.problems import INVERTIBLE, Problem, random_histories
from tests.test_hysid.command import F, T, X, run, sponge

from .._measure import Row, judged, noted

ROWS, GROUPS, COLUMNS, THREADS = 10_000_000, 1_000, 500, 8
CHECKED, SECONDS = 10_000, 60.0
"""Groups that `check` looks at, and the processor time in which it does."""
MONITORED, BLOCK = 10_000_000, 100_000
"""Steps of a compensator that recalibrates itself, and in one go."""
STEPS, HOSTILE = 100_000_000, 1_000_000
"""Steps in C: good ones over all models together, and ones that no sensor gives of each model."""
SANITIZERS = ("-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
FIT = ("--input", F, "--output", X, "--time", T, "--model", "LinearSponge", "--out", "out")

PEAK = """
import resource, subprocess, sys
subprocess.run([sys.executable, "-m", "hysid", *sys.argv[1:]], check=True, capture_output=True)
used = resource.getrusage(resource.RUSAGE_CHILDREN)
print(used.ru_maxrss, used.ru_utime + used.ru_stime)
"""

LOOP = """\
#include <stdio.h>
#include "it.h"

static const double broken[] = {NAN, INFINITY, -INFINITY, 1e308, -1e308, 1e200, 1e-320, -0.0};
static const double clocks[] = {NAN, INFINITY, -INFINITY, 1e308, 1e150, 1e12, 1e-320, -1.0, 0.0};

int main(void)
{
    static double y[%(count)d];
    unsigned long long seed = 1;
    it_state s;
    FILE *file = fopen("y.bin", "rb");
    if (!file || fread(y, sizeof y[0], %(count)d, file) != %(count)d) { return 2; }
    it_reset(&s);
    for (long k = 0; k < %(steps)dL; ++k) {
        it_real u, off;
        double dt = 0.01, reading = y[k %% %(count)d];
        seed = seed * 6364136223846793005ULL + 1442695040888963407ULL;
        unsigned at = (unsigned)(seed >> 36);
        if (%(hostile)d && k && at %% 2) {
            dt = at & 2 ? clocks[(at >> 4) %% (sizeof clocks / sizeof clocks[0])] : dt;
            reading = at & 4 ? broken[(at >> 8) %% (sizeof broken / sizeof broken[0])]
                : at & 8 ? 4 * y[(at >> 8) %% %(count)d] : reading;
        }
        int status = it_step(&s, (it_real)dt, (it_real)reading, &u, &off);
        if (!isfinite((double)u) || status < IT_OK || status > IT_INVALID) { return 1; }
    }
    return 0;
}
"""


def large_files() -> list[Row]:
    """Tables of many rows, columns and groups: commands that do not end with 0."""
    t, force, stroke = (np.array(c, float) for c in list(zip(*sponge(), strict=True))[:3])
    failed = []

    def tried(what: str, *command: object) -> None:
        if (done := run(*command)).code:
            failed.append(what)
            print(f"{what}: {done.err}", file=sys.stderr)

    wide = np.column_stack([t, force, stroke, *[stroke] * (COLUMNS - 3)])
    names = [T, F, X, *(f"channel {k} (V)" for k in range(COLUMNS - 3))]
    np.savetxt("wide.csv", wide, "%.6g", ",", header=",".join(names), comments="")
    tried(f"{COLUMNS} columns", "fit", "wide.csv", *FIT)
    _grouped(GROUPS, "groups.csv")
    _grouped(CHECKED, "many.csv")
    tried(f"{GROUPS} groups", "fit", "groups.csv", *FIT, "--group", "run", "--overwrite")
    since = np.arange(100_000) / 1000  # presses of two seconds, read every millisecond
    pressed = 20 * np.sin(np.pi * since / 2) ** 2
    block = np.column_stack([pressed, 1.3 * pressed + 6 + 0.1 * (since // 2 % 7)])
    with Path("long.csv").open("w") as file:
        file.write(f"{T},{F},{X}\n")
        lines = [f"{f:.5g},{x:.5g}\n" for f, x in block]
        for begin in range(0, ROWS, len(lines)):
            file.writelines(f"{(begin + k) / 1000:.3f},{line}" for k, line in enumerate(lines))
    what = f"tables of {COLUMNS} columns and of {GROUPS:,} groups: fits that failed, of 2"
    checked, long = _more(ROWS // 2, ROWS, "check", *FIT[:6])
    many = _used("check", "many.csv", *FIT[:6], "--group", "run")[1]
    fitted, _ = _more(ROWS // 5, ROWS, "fit", *FIT, "--overwrite")
    further = "takes more for each further byte of a text"
    return [
        judged(what, len(failed), 0),
        judged(f"memory that check {further}", checked, 2.0),
        judged(f"memory that fit {further}", fitted, 3.0),
        judged(f"check of {ROWS:,} rows, processor time in s", long, SECONDS),
        judged(f"check of {CHECKED:,} groups, processor time in s", many, SECONDS),
    ]


def _grouped(groups: int, name: str) -> np.ndarray:
    """A file of so many short sequences."""
    group, each = np.repeat(np.arange(groups), 20), np.arange(20) / 19
    force = np.tile(20 * np.sin(np.pi * each), groups)
    table = np.column_stack(
        [np.tile(each, groups), force, 1.3 * force + 6 + 0.1 * (group % 7), group]
    )
    np.savetxt(name, table, "%.6g", ",", header=f"{T},{F},{X},run", comments="")
    return table


def _more(few: int, many: int, command: str, *options: object) -> tuple[float, float]:
    """Bytes of memory for each further byte of a text of few and of many rows; seconds for the latter."""
    sizes, peaks = [], []
    for count in (few, many):  # without what a command takes of any file
        with Path("long.csv").open() as file, Path("part.csv").open("w") as part:
            part.writelines(islice(file, count + 1))
        sizes.append(Path("part.csv").stat().st_size)
        peak, seconds = _used(command, "part.csv", *options)
        peaks.append(peak)
    return (peaks[1] - peaks[0]) / (sizes[1] - sizes[0]), seconds


def _used(*command: object) -> tuple[float, float]:
    """Bytes of memory at most, and seconds of processor time, of a command in a process of its own."""
    words = [sys.executable, "-c", PEAK, *map(str, command)]
    done = subprocess.run(words, check=True, capture_output=True, text=True)
    peak, seconds = map(float, done.stdout.split()[-2:])
    return 1e3 * peak, seconds


def many_steps() -> list[Row]:
    """The step of every exportable model in C, over good readings, again and again."""
    if not shutil.which("gcc"):
        return [noted("steps in C", 0, reason="needs gcc")]
    rows, count = [], len(INVERTIBLE)
    for flags, each, said in (
        (("-O2",), STEPS // count, ""),
        (SANITIZERS, HOSTILE, ", half of them hostile, under sanitizers"),
    ):
        wrong = [p.name for p in INVERTIBLE if not _ends_well(p, each, flags)]
        what = f"{each * count:,} steps in C{said}: models that gave no number, of {count}"
        rows.append(judged(f"{what} {', '.join(wrong[:3])}".rstrip(), len(wrong), 0))
    return rows


def _ends_well(problem: Problem, steps: int, flags: tuple[str, ...]) -> bool:
    model, count = problem.model(), 1000
    u = random_histories(np.random.default_rng(0), problem.low, problem.high, (1, count))[0]
    t = 0.01 * np.arange(1.0, count + 1)
    y = np.asarray(model.simulate(t, u))
    export_c(model, Path("it.h"), y, times=t, depth=256)
    y.tofile("y.bin")
    words = {"count": count, "steps": steps, "hostile": flags == SANITIZERS}
    Path("loop.c").write_text(LOOP % words, "utf-8")
    subprocess.run(["gcc", *STRICT, *flags, "loop.c", "-o", "loop", "-lm"], check=True)
    return subprocess.run(["./loop"], check=False).returncode == 0


def monitored() -> list[Row]:
    """An unchanged sensor, watched for long: memory, changes that are found, what is learnt."""
    t, force, stroke = (np.array(c, float) for c in list(zip(*sponge(), strict=True))[:3])
    record = Record.from_arrays(force, stroke, time=t)
    own = adaptive(identify.fit(record, "Preisach", starts=1).model, record)
    turns = BLOCK // len(t)
    u, y = np.tile(force, turns), np.tile(stroke, turns)
    clock = np.arange(len(u)) * float(np.median(np.diff(t)))
    known = np.where(np.arange(len(u)) % 50 == 0, u, np.nan)
    state, steps, held = own.init(), 0, list[int]()
    while steps < MONITORED:
        state, found = own.follow(clock + steps * clock[1], y, known, state)
        steps += len(u)
        pages = int(Path("/proc/self/statm").read_text().split()[1])
        held.append(pages * resource.getpagesize())
    grown, late = held[-1] - held[len(held) // 4], (int(found.changes[-1]), float(found.gain[-1]))
    what = f"{steps:,} steps of a compensator that recalibrates itself"
    return [
        judged(f"{what}: memory that it has grown by, in MB", grown / 1e6, 20.0),
        judged("... changes found where nothing changed", late[0], 0),
        judged("... gain learnt, beside that of the fit", abs(late[1] - 1), 0.02),
    ]


def at_once() -> list[Row]:
    """A model in eight threads, and fits in processes of other kinds."""
    t, force, stroke = (np.array(c, float) for c in list(zip(*sponge(), strict=True))[:3])
    record = Record.from_arrays(force, stroke, time=t)
    fit = identify.fit(record, "Preisach")
    inverse = invert(fit.model)
    streams = [stroke * k / THREADS for k in range(1, THREADS + 1)] * 25

    def estimated(y: np.ndarray) -> np.ndarray:
        return np.asarray(inverse.simulate(t, y).value)

    alone = [estimated(y) for y in streams]
    with ThreadPoolExecutor(THREADS) as pool:
        together = list(pool.map(estimated, streams))
    other = sum(not np.array_equal(*pair) for pair in zip(alone, together, strict=True))
    what = f"{THREADS} threads with one model: other estimates, of {len(streams)} streams"
    rows = [judged(what, other, 0)]
    for kind in ("spawn", "forkserver"):
        if kind not in multiprocessing.get_all_start_methods():
            continue
        with ProcessPoolExecutor(2, multiprocessing.get_context(kind)) as pool:
            found = list(pool.map(partial(_predicted, t, force), [stroke] * 2))
        off = max(float(np.abs(one - fit.predict(record)).max()) for one in found)
        what = f"fits in processes that {kind} makes: difference over the range"
        rows.append(judged(what, off / float(np.ptp(stroke)), 1e-12))
    return rows


def _predicted(t: np.ndarray, force: np.ndarray, stroke: np.ndarray) -> np.ndarray:
    import jax  # a new process, which knows no setting of its parent's

    jax.config.update("jax_enable_x64", True)
    record = Record.from_arrays(force, stroke, time=t)
    return identify.fit(record, "Preisach").predict(record)
