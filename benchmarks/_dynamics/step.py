"""The time of one exported step in C99."""

import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np

import compensate
import identify
from identify.results._detail import Motion

SOURCE = """
#include <stdio.h>
#include <time.h>
#include "plant.h"
int main(void)
{
    plant_state s;
    const int wrong = plant_self_test(&s);
    double sum = 0.0, best = 1e9;
    for (int round = 0; round < 7; ++round) {
        struct timespec a, b;
        clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &a);
        for (int k = 0; k < STEPS; ++k) {
            double y;
            (void)plant_step(&s, PERIOD, plant_forces[k & 1023], &y, 0);
            sum += y;
        }
        clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &b);
        const double took = 1e6 * (double)(b.tv_sec - a.tv_sec) + 1e-3 * (double)(b.tv_nsec - a.tv_nsec);
        best = took < best ? took : best;
    }
    printf("%d %.6f %g\\n", wrong, best / STEPS, sum);
    return 0;
}
"""


def microseconds(fit: identify.FitResult, steps: int) -> float | None:
    """Processor time of a step under the force of the record, the least of seven rounds; None without a
    compiler.

    Raises `ValueError` where the header does not give its golden displacements.
    """
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if compiler is None:
        return None
    assert isinstance(fit.detail, Motion)
    motion = fit.detail.recorded
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        times = motion.dt * np.arange(len(motion.force))
        compensate.export_c(motion.model, folder / "plant.h", motion.force, times=times)
        values = ", ".join(map(repr, motion.force[:1024].tolist()))
        forces = f"static const double plant_forces[1024] = {{{values}}};\n"
        source = (
            SOURCE.replace("STEPS", str(steps))
            .replace("PERIOD", repr(float(motion.dt)))
            .replace("int main", forces + "int main", 1)
        )
        (folder / "run.c").write_text("#define _POSIX_C_SOURCE 199309L\n" + source)
        command = [
            compiler,
            "-O2",
            "-std=c99",
            "-o",
            str(folder / "run"),
            str(folder / "run.c"),
            "-lm",
        ]
        subprocess.run(command, check=True)
        found = subprocess.run([str(folder / "run")], check=True, capture_output=True, text=True)
    wrong, took, _ = found.stdout.split()
    if wrong != "0":
        raise ValueError(f"{wrong} of the golden displacements are wrong")
    return float(took)
