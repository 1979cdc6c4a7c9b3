"""Every target against the C99 header over a long stream: NaN, a reset, a state saved and restored."""

import ctypes
import json
import subprocess
import sys
import tempfile
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from compensate.export._export import Exported, Program
from compensate.export.targets._export_to import write_to
from compensate.runtime import load
from hysteresis import Burgers
from tests.c_harness import Compiled
from tests.judges import JUDGES
from tests.problems import random_histories
from tests.targets import grid
from tests.test_compensate.test_targets import ROOT, ROS_MAIN, integers, run_fixed, slave

from .._measure import Row, judged, noted

BAD = 0.02
"""Part of the readings that is NaN or infinite."""
STEP = 0.02


class Stream(NamedTuple):
    """Readings and inputs of a model, and what they are exported from."""

    program: Program
    u: np.ndarray
    y: np.ndarray

    @property
    def quarter(self) -> int:
        """Where the state is saved; it is restored after as many rows, and reset after these again."""
        return len(self.y) // 4

    def wanted(self, folder: Path, stamped: bool) -> np.ndarray:
        """The header's estimates: two quarters, the second one again, and the rest after a reset.

        `stamped`: times are multiples of the step, and dt is the difference of two.
        """
        q, rows = self.quarter, len(self.y)
        dt = np.diff(STEP * np.arange(rows), prepend=0.0) if stamped else np.full(rows, STEP)
        header = self.program.write_c(folder / "reference.h").path
        it = Compiled(header, flags=("-O2", "-ffp-contract=off"))
        first, _ = it.run(dt[: 2 * q], self.y[: 2 * q])
        rest, _ = it.run(dt[: rows - 2 * q], self.y[2 * q :])
        return np.concatenate([first, first[q:], rest])


def stream(kind: str, rows: int) -> Stream:
    """A grid of 20x20 cells, or a Burgers model, and a random history with bad readings."""
    rng = np.random.default_rng(7)
    model, low, high = (
        (grid(20), 0.0, 1.0) if kind == "grid" else (Burgers(2.0, 40.0, 1.0, 5.0), 0.0, 4.0)
    )
    u = np.concatenate(
        [
            random_histories(rng, low, high, (1, min(rows, 10_000)))[0]
            for _ in range(-(-rows // 10_000))
        ]
    )[:rows]
    t = STEP * np.arange(rows)
    y = np.asarray(model.simulate(t, u))
    limits = (float(y.min()) - 1, float(y.max()) + 1)
    program = Program(model, y[:1000], times=t[:1000], trained=(low, high), limits=limits)
    bad = rng.random(rows) < BAD
    return Stream(program, u, np.where(bad, rng.choice([np.nan, np.inf, -np.inf], rows), y))


def written(one: Stream, target: str, path: Path) -> Path:
    """Export for a target."""
    done: Exported = write_to(target, one.program, path, None)
    return done.path


def in_python(one: Stream, folder: Path) -> np.ndarray:
    """The runtime; it has no saved states, so the second quarter is run once more from the start."""
    compensator, q = load(written(one, "runtime", folder / "it.json")), one.quarter

    def run(rows: slice) -> list[float]:
        return [compensator.step(STEP, reading).value for reading in one.y[rows].tolist()]

    first = run(slice(0, 2 * q))
    compensator.reset()
    return np.array([*first, *first[q:], *run(slice(2 * q, None))])


def in_fmu(target: str) -> Callable[[Stream, Path], np.ndarray]:
    """The binary of an FMU, its state taken and set by FMPy."""

    def run_all(one: Stream, folder: Path) -> np.ndarray:
        made: Any = slave(written(one, target, folder / "sensor.fmu"), folder)
        three, q = target == "fmu3", one.quarter
        names = ("fmi3SetFloat64", "fmi3DoStep", "fmi3GetFloat64") if three else (
            "fmi2SetReal", "fmi2DoStep", "fmi2GetReal")  # fmt: skip
        put, step, get = (getattr(made.dll, name) for name in names)
        of = ctypes.c_void_p(made.component)
        reading, value, last = (ctypes.c_double() for _ in range(3))
        flags = [ctypes.c_bool() for _ in range(3)]
        places = [(ctypes.c_uint * 1)(k) for k in (1, 2)]
        count, more = ctypes.c_size_t(1), ([ctypes.c_size_t(1)] if three else [])
        ends = [*map(ctypes.byref, flags), ctypes.byref(last)] if three else []
        given, found_at = ctypes.byref(reading), ctypes.byref(value)
        for function in (put, step, get):
            function.argtypes = None

        def run(rows: slice, begin: int) -> list[float]:
            found = []
            for k, y in enumerate(one.y[rows].tolist(), begin):
                reading.value = y
                put(of, places[0], count, given, *more)
                step(of, ctypes.c_double(STEP * k), ctypes.c_double(STEP), 0, *ends)
                get(of, places[1], count, found_at, *more)
                found.append(value.value)
            return found

        first = run(slice(0, q), 0)
        kept = made.getFMUState() if three else made.getFMUstate()
        second = run(slice(q, 2 * q), q)
        (made.setFMUState if three else made.setFMUstate)(kept)
        again = run(slice(q, 2 * q), q)
        made.reset()
        return np.array([*first, *second, *again, *run(slice(2 * q, None), 0)])

    return run_all


def in_ros(one: Stream, folder: Path) -> np.ndarray:
    """The scalar plugin beside stubs; it is reset by its service and has no saved states."""
    out = written(one, "ros2", folder / "sensor")
    (folder / "main.cpp").write_text(ROS_MAIN)
    command = ["g++", "-std=c++17", "-O2", "-ffp-contract=off", "-I", str(ROOT / "tests" / "stubs")]
    command += ["-I", str(out / "src"), "main.cpp", "-pthread", "-o", "it"]
    subprocess.run(command, cwd=folder, check=True)
    rows, q = [f"0 {y!r} 0" for y in one.y.tolist()], one.quarter
    said = "\n".join([*rows[: 2 * q], "-1 0 0", *rows[2 * q :]])
    ran = subprocess.run(
        [folder / "it", "scalar"], input=said, capture_output=True, text=True, check=True
    )
    found = [float.fromhex(x) for x in ran.stdout.split()]
    return np.array([*found[: 2 * q], *found[q : 2 * q], *found[2 * q :]])


def in_mujoco(one: Stream, folder: Path) -> np.ndarray:
    """The plugin's sensor, its state saved and restored with that of the simulation."""
    mujoco: Any = import_module("mujoco")  # which only this part needs

    stem = f"measured_{folder.name}"
    out = written(one, "mujoco", folder / stem)
    mujoco.mj_loadPluginLibrary(str(out / f"lib{stem}.so"))
    model = mujoco.MjModel.from_xml_path(str(out / "example.xml"))
    data, q, kind = mujoco.MjData(model), one.quarter, mujoco.mjtState.mjSTATE_INTEGRATION

    def run(rows: slice) -> list[float]:
        found = []
        for y in one.y[rows].tolist():
            data.qpos[0], data.qvel[0] = y, 0.0
            mujoco.mj_step(model, data)
            found.append(float(data.sensordata[1]))
        return found

    first = run(slice(0, q))
    kept = np.empty(mujoco.mj_stateSize(model, kind))
    mujoco.mj_getState(model, data, kept, kind)
    second = run(slice(q, 2 * q))
    mujoco.mj_setState(model, data, kept, kind)
    again = run(slice(q, 2 * q))
    mujoco.mj_resetData(model, data)
    return np.array([*first, *second, *again, *run(slice(2 * q, None))])


def in_onnx(one: Stream, folder: Path) -> np.ndarray:
    """onnxruntime; the state is an array."""
    onnxruntime: Any = import_module("onnxruntime")  # which only this part needs

    file, q = written(one, "onnx", folder / "it.onnx"), one.quarter
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    session = onnxruntime.InferenceSession(str(file), options, ["CPUExecutionProvider"])
    begin = np.array(json.loads(session.get_modelmeta().custom_metadata_map["initial_state"]))

    def run(rows: slice, state: np.ndarray) -> tuple[list[float], np.ndarray]:
        found = []
        for y in one.y[rows]:
            fed = {"dt": np.asarray(STEP), "reading": np.asarray(y), "state": state}
            value, _, _, state = session.run(None, fed)
            found.append(float(value))
        return found, state

    first, kept = run(slice(0, q), begin)
    second, _ = run(slice(q, 2 * q), kept)
    again, _ = run(slice(q, 2 * q), kept)
    rest, _ = run(slice(2 * q, None), begin)
    return np.array([*first, *second, *again, *rest])


def in_sklearn(one: Stream, folder: Path) -> np.ndarray:
    """The package in a process without hysid; each `predict` is a reset."""
    written(one, "sklearn", folder / "sensor")
    np.save(folder / "y.npy", one.y)
    q = one.quarter
    program = (
        "import numpy as np; from sensor import Compensator as C; y = np.load('y.npy')[:, None];"
        f" c = C(dt={STEP}).fit(y); a = c.predict(y[:{2 * q}]);"
        f" np.save('u.npy', np.concatenate([a, a[{q}:], c.predict(y[{2 * q}:])]))"
    )
    subprocess.run([sys.executable, "-c", program], cwd=folder, check=True)
    return np.load(folder / "u.npy")


RUNS: dict[str, tuple[str, Callable[[Stream, Path], np.ndarray], float]] = {
    "runtime": ("gcc", in_python, 1.0), "sklearn": ("scikit-learn", in_sklearn, 1.0),
    "fmu": ("FMPy", in_fmu("fmu"), 1.0), "fmu3": ("FMPy", in_fmu("fmu3"), 1.0),
    "ros2": ("g++", in_ros, 1.0), "mujoco": ("MuJoCo", in_mujoco, 1.0),
    "onnx": ("onnxruntime", in_onnx, 0.02),
}  # fmt: skip
"""The judge of each target, what runs it, and the part of the samples that it can run in some minutes."""


def identity(quick: bool) -> list[Row]:
    """Estimates that differ from the header's in any bit."""
    rows = 20_000 if quick else 1_000_000
    found = []
    for kind in ("grid", "burgers"):
        whole = stream(kind, rows)
        for target, (judge, run, part) in RUNS.items():
            # MuJoCo's clock is a sum of its steps, so that dt has other last bits than STEP.
            if target == "mujoco" and kind == "burgers":
                continue
            count = max(int(part * rows), 4000)
            what = f"{target}, {kind}: estimates with other bits than the header's, of {count:,}"
            if JUDGES[judge].missing:
                found.append(noted(what, float("nan"), reason=f"no {judge} here"))
                continue
            one = whole._replace(u=whole.u[:count], y=whole.y[:count])
            if target == "mujoco":
                # A position that is not finite is a simulation that blew up: MuJoCo resets it.
                one = one._replace(
                    y=np.where(np.isfinite(one.y), one.y, one.y[np.isfinite(one.y)].min())
                )
            with tempfile.TemporaryDirectory() as place:
                wanted = one.wanted(Path(place), judge == "FMPy")
                differ = run(one, Path(place)).view(np.int64) != wanted.view(np.int64)
            found.append(judged(what, int(differ.sum()), 0))
    return [*found, _fixed(rows)]


def _fixed(rows: int) -> Row:
    """The largest error of fixed point beside the header, over good readings."""
    one = stream("grid", rows)
    y = one.y[np.isfinite(one.y)]
    what = f"fixed point: largest difference to the header in parts of the range, of {len(y):,}"
    with tempfile.TemporaryDirectory() as place:
        out = write_to("arduino", one.program, Path(place) / "sensor", "fixed").path
        given, number = integers(out / "src" / "sensor.h", y)
        found, _ = run_fixed(out / "src" / "sensor.h", given)
        header = one.program.write_c(Path(place) / "reference.h").path
        value, _ = Compiled(header).run(np.full(len(y), STEP), y)
    return judged(what, float(np.abs(number(found) - value).max() / np.ptp(one.u)), 2e-4)
