"""One contact after the other in a process that is kept on one core, as a control loop is run.

Called by `benchmarks._armor.contacts`: which cores there are has to be said before JAX makes its threads.
"""

import os
import subprocess
import sys
import time


def on_one_core(steps: int = 5000) -> float:
    """Median microseconds of a step of `ContactStream` in such a process."""
    command = [sys.executable, "-m", "benchmarks._armor.one_core", str(steps)]
    return float(subprocess.run(command, capture_output=True, text=True, check=True).stdout)


def main(steps: int) -> None:
    """Keep to one core where the system can, step, and print."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    import jax
    import numpy as np

    jax.config.update("jax_enable_x64", True)
    from compensate.armor import Box, ContactSolver, ContactStream
    from hysteresis import LinearSponge

    stream = ContactStream(ContactSolver(Box(0.3, 0.3, 0.55), LinearSponge(1.298, 6.186)))
    taken = []
    for k in range(steps):
        force = (8 + 7 * np.sin(k / 50)) * np.array([0.1, 0.05, -1.0])
        moment = np.cross([0.1, 0.05, 0.53], force)
        begin = time.perf_counter_ns()
        stream.step(0.01 * k, force, moment)
        taken.append(time.perf_counter_ns() - begin)
    print(float(np.median(taken)) / 1e3)


if __name__ == "__main__":
    main(int(sys.argv[1]))
