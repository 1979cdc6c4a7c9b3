"""FMUs: validation, size, and the way from a CSV to one that runs."""

import os
import subprocess
import sys
import tempfile
import time
import zipfile
from pathlib import Path

import numpy as np

from compensate.export._export import Program
from compensate.export.targets._export_to import write_to
from tests.judges import JUDGES
from tests.problems import random_histories
from tests.targets import grid

from .._measure import Row, judged, noted

ROOT = Path(__file__).parents[2]
RUN = """
import fmpy
from fmpy.validation import validate_fmu
assert validate_fmu("sponge.fmu") == []
found = fmpy.simulate_fmu("sponge.fmu", stop_time=1.0, output_interval=0.1)
assert len(found) > 5
"""


def units(quick: bool) -> list[Row]:
    """The same for `quick`."""
    if JUDGES["FMPy"].missing:
        return [noted("FMU", float("nan"), reason="no FMPy here")]
    from fmpy.validation import validate_fmu  # which only this part needs

    rows = []
    u = random_histories(np.random.default_rng(3), 0.0, 1.0, (1, 1000))[0]
    model = grid(20)
    program = Program(model, model.simulate(None, u), trained=(0.0, 1.0))
    with tempfile.TemporaryDirectory() as place:
        for target in ("fmu", "fmu3"):
            file = write_to(target, program, Path(place) / f"{target}.fmu", None).path
            with zipfile.ZipFile(file) as archive:
                beside = sum(
                    i.compress_size
                    for i in archive.infolist()
                    if not i.filename.startswith("binaries/")
                )
            rows += [
                judged(f"{target}: messages of FMPy's validation", len(validate_fmu(str(file))), 0),
                judged(f"{target} of a 20x20 grid: kB beside the binary", beside / 1000, 100),
            ]
    return [*rows, _from_csv()]


def _from_csv() -> Row:
    """Minutes that three commands take, with compiled programs of none before."""
    data = ROOT / "datasets" / "sponge-50mm-cycles.csv"
    with tempfile.TemporaryDirectory() as place:
        environment = os.environ | {"PYTHONPATH": str(ROOT), "XDG_CACHE_HOME": place}
        command = [sys.executable, "-m", "hysid"]
        columns = ["--input", "force (N)", "--output", "displacement (mm)", "--time", "time (s)"]
        begin = time.perf_counter()
        for line in (
            [*command, "fit", str(data), *columns, "--test-cycles", "1", "--out", "fit"],
            [*command, "export", "fit", "--to", "fmu", "sponge.fmu"],
            [sys.executable, "-c", RUN],
        ):
            subprocess.run(line, cwd=place, env=environment, check=True, capture_output=True)
        minutes = (time.perf_counter() - begin) / 60
    return judged("from a CSV to an FMU that runs: minutes of commands", minutes, 10)
