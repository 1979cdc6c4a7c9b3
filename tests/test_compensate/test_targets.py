"""Targets of `hysid export --to`: what each is made for runs it, and the estimates are those of the C99."""

import ctypes
import errno
import gc
import json
import re
import subprocess
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from compensate import Quantity, Status, export_to
from hysteresis import InputError, Preisach
from hysteresis.preisach import GridDensity
from tests.boards import on_avr, on_cortex_m4
from tests.c_harness import STRICT, ran
from tests.judges import JUDGES
from tests.problems import random_histories
from tests.refusals import raises
from tests.targets import ORIGIN, case, grid, with_gaps
from tests.thorough import rest_thorough

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize(
    ("name", "real"), [("relays", "fixed"), ("creep", "float"), ("conditioned", "float")]
)
@JUDGES["g++"].needed
def test_the_example_compiles(name: str, real: str, tmp_path: Path):
    out = case(name).write("arduino", tmp_path / "sensor", real)
    example = out / "examples" / "Compensate" / "Compensate.ino"
    stub = ROOT / "tests" / "stubs"
    command = ["g++", "-x", "c++", "-std=c++11", "-Wall", "-Wextra", "-Werror", "-fsyntax-only"]
    assert ran(*command, "-I", stub, "-I", out / "src", example).stderr == ""


def test_an_export_says_each_unit_once(tmp_path: Path):
    """Also a unit whose letters are in the name; none where there is none."""
    one = case("plays")
    units = {"reading": Quantity("displacement", "m"), "estimate": Quantity("force (N)", "N")}
    out = export_to("arduino", one.model, tmp_path / "sensor", one.y, **units).path
    assert "\n| reading | displacement in m, from" in (out / "README.md").read_text()
    assert "\n| estimate | force (N) |" in (out / "README.md").read_text()
    assert "\n * reading: displacement in m, from" in (out / "src" / "sensor.h").read_text()
    out = export_to("arduino", one.model, tmp_path / "sensor", one.y).path
    assert "\n| reading | output, from" in (out / "README.md").read_text()


def test_a_clock_without_a_unit_is_said_to_be_in_seconds(tmp_path: Path):
    one = case("creep")
    for unit, count in (("s", 0), ("1", 1)):
        options = {"times": one.t, "time_unit": unit}
        done = export_to("ros2", one.model, tmp_path / "sensor", one.y, **options)
        assert len(done.notes) == count
    assert "| time | a unit that is not known |" in (done.path / "README.md").read_text()


def test_a_folder_is_replaced_only_where_an_export_wrote_it(tmp_path: Path):
    one = case("creep")
    one.write("arduino", tmp_path / "sensor")
    (tmp_path / "sensor" / "old").write_text("")
    one.write("arduino", tmp_path / "sensor")
    assert not (tmp_path / "sensor" / "old").exists()
    assert [p.name for p in tmp_path.iterdir()] == ["sensor"]
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.tex").write_text("")
    with raises("would-overwrite", "no export has written"):
        one.write("arduino", tmp_path / "mine")
    for name in ("1st", "a-b"):
        with pytest.raises(InputError, match="cannot be the name"):
            one.write("arduino", tmp_path / name)
    for target, real in (("plc", None), ("arduino", "double")):
        with raises("bad-option"):
            export_to(target, one.model, tmp_path / "it", one.y, real=real)


def test_a_full_disk_is_said_of_the_file_that_was_asked_for(tmp_path, monkeypatch):
    def full(self: Path, _: bytes) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    for target, out in (("c", tmp_path / "sensor.h"), ("arduino", tmp_path / "sensor")):
        with pytest.raises(OSError, match="No space left") as error:
            case("plays").write(target, out)
        assert error.value.filename == str(out)
    assert not [*tmp_path.iterdir()]


def test_a_kill_while_a_folder_is_replaced_loses_nothing(tmp_path, monkeypatch):
    """Killed between the renamings it lies beside; the next export puts it back, even one that fails."""
    one, out = case("creep"), tmp_path / "sensor"
    one.write("arduino", out)
    (out / "earlier").write_text("")
    out.rename(tmp_path / "sensor.old-abc")
    there = []

    def failing(self: Path, target: Path) -> None:
        there.extend(path.name for path in tmp_path.glob("sensor*/earlier"))
        raise KeyboardInterrupt

    monkeypatch.setattr(Path, "chmod", failing)
    with pytest.raises(KeyboardInterrupt):
        one.write("arduino", out)
    monkeypatch.undo()
    assert there == ["earlier"]
    assert [path.name for path in tmp_path.iterdir()] == ["sensor"]
    one.write("arduino", out)
    assert [path.name for path in tmp_path.iterdir()] == ["sensor"]
    assert not (out / "earlier").exists()


@JUDGES["simavr"].needed
def test_an_atmega328_gives_the_estimates_of_float(tmp_path: Path):
    """Bit for bit: its library rounds sums, products, quotients and roots as a PC does."""
    one = case("relays")
    y = one.y[:120].astype(np.float32)
    reference = one.reference(tmp_path, "float")
    out = one.write("arduino", tmp_path / "sensor")
    board = on_avr(out / "src" / "sensor.h", y)
    value, status = reference.run(np.zeros(len(y)), y.astype(float))
    np.testing.assert_array_equal(board.value, value.astype(np.float32))
    np.testing.assert_array_equal(board.status, status)
    assert board.ram <= 1200


def fmu(name: str, target: str, folder: Path) -> Path:
    return case(name).write(target, folder / "sensor.fmu")


@pytest.mark.parametrize(("name", "dt"), [("creep", 0.02), ("plays", 0.0)])
@JUDGES["QEMU"].needed
def test_a_cortex_m4_gives_the_estimates_of_float_in_250_instructions(name, dt, tmp_path):
    """Bit for bit. The first step of an even clock, which tabulates its exponentials, takes more."""
    one = case(name)
    y = one.y[:60].astype(np.float32)
    out = one.write("arduino", tmp_path / "sensor")
    board = on_cortex_m4(out / "src" / "sensor.h", y, dt)
    value, status = one.reference(tmp_path, "float").run(np.full(len(y), 0.02), y.astype(float))
    np.testing.assert_array_equal(board.value, value.astype(np.float32))
    np.testing.assert_array_equal(board.status, status)
    assert board.cycles[2:].max() <= 250


def integers(header: Path, readings: np.ndarray) -> tuple[np.ndarray, Callable[..., np.ndarray]]:
    """Readings as a header in fixed point takes them, and its estimates as numbers."""
    facts = dict(re.findall(r"#define SENSOR_(\w+) (\S+)$", header.read_text(), re.MULTILINE))
    zero, step, first, size = (
        float(facts[f"{role}_{what}"])
        for role in ("READING", "ESTIMATE")
        for what in ("ZERO", "STEP")
    )
    return np.round((readings - zero) / step).astype(np.int32), lambda found: first + found * size


FIXED = """
#include "sensor.h"
int run(long n, const int *y, int *u, int *status);
int run(long n, const int *y, int *u, int *status)
{
    sensor_state s;
    sensor_reset(&s);
    for (long k = 0; k < n; ++k) {
        status[k] = sensor_step(&s, 0, y[k], &u[k], 0);
    }
    return sensor_self_test(&s);
}
"""


def run_fixed(header: Path, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Estimates as integers, and statuses; the self test counts none."""
    source = header.with_name("run.c")
    source.write_text(FIXED)
    ran("gcc", *STRICT, "-O2", "-shared", "-fPIC", source, "-o", f"{source}.so")
    u, status = np.empty_like(y), np.empty_like(y)
    given = [a.ctypes.data_as(ctypes.c_void_p) for a in (y, u, status)]
    assert ctypes.CDLL(f"{source}.so").run(ctypes.c_long(len(y)), *given) == 0
    return u, status


def test_first_states_stay_where_memory_is_freed():
    """CPython 3.13.0 empties lists of a `__dict__` that outlives its object."""
    program = case.__wrapped__("relays").program
    gc.collect()
    ((relays,),) = program.document()["starts"]
    assert len(relays["extremum"]) == len(relays["level"]) == 64


@JUDGES["gcc"].needed
def test_fixed_point_is_the_header_to_2e_4_of_the_range(tmp_path: Path):
    """Statuses of the guard too. Where a reading is beyond all outputs, the end is held."""
    one = case("relays")
    header = one.write("arduino", tmp_path / "sensor", "fixed") / "src" / "sensor.h"
    # At rest noise takes readings beyond the outputs, by less than the estimate's error.
    rest = one.program.document()["tree"]["parameters"]["floor"] - 0.01
    y = np.concatenate([one.y, [rest, one.y.min() - 0.3, one.y.max() + 0.3, one.y.mean()]])
    given, number = integers(header, y)
    found, status = run_fixed(header, given)
    value, wanted = one.reference(tmp_path).run(np.zeros(len(y)), y)
    assert np.abs(number(found) - value).max() <= 2e-4 * np.ptp(one.u)
    # Without a second memory the end of the run-in is told later, by an end of the trained inputs.
    early = status == Status.RUN_IN
    assert early[wanted == Status.RUN_IN].all()
    np.testing.assert_array_equal(status[~early], wanted[~early])
    assert not early[-1]
    assert (status[-3:-1] == Status.EXTRAPOLATED).all()
    ends = np.array([-(2**31), -(2**31) + 1, 2**31 - 1], np.int32)
    found, status = run_fixed(header, ends)
    assert status.tolist() == [Status.INVALID, Status.EXTRAPOLATED, Status.EXTRAPOLATED]
    assert (np.diff(found[1:]) > 0).all()
    for name, real in (("creep", "fixed"), ("conditioned", "fixed")):
        with raises("not-exportable", "Preisach grid"):
            case(name).write("arduino", tmp_path / name, real)


@JUDGES["gcc"].needed
@pytest.mark.parametrize("reversals", [40, 300])
def test_fixed_point_follows_loops_within_a_cell(reversals: int, tmp_path: Path):
    """However little of it is reversible; more of them than a byte counts."""
    model = Preisach(GridDensity(0.0, 1.0, np.tril(np.full((5, 5), 1 / 15))), np.full(5, 1e-3))
    swing = np.linspace(0.5, 0.01, reversals) * (-1.0) ** np.arange(reversals)
    u = 0.5 + np.concatenate([swing, swing[::-1]])
    y = np.asarray(model.simulate(None, u))
    out = export_to("arduino", model, tmp_path / "sensor", y, real="fixed").path
    given, number = integers(out / "src" / "sensor.h", y)
    found, _ = run_fixed(out / "src" / "sensor.h", given)
    assert np.abs(number(found) - u).max() <= 2e-4


@JUDGES["simavr"].needed
def test_an_atmega328_takes_3000_cycles_for_a_step_in_fixed_point(tmp_path: Path):
    """Of a 20x20 grid, in 1.2 kB of RAM; with the integers of a PC."""
    model = grid(20)
    u = random_histories(np.random.default_rng(3), 0.0, 1.0, (1, 240))[0]
    readings = np.asarray(model.simulate(None, u))
    options = {"trained": (0.0, 1.0), "real": "fixed"}
    out = export_to("arduino", model, tmp_path / "sensor", readings, **options)
    given, number = integers(out.path / "src" / "sensor.h", readings)
    board = on_avr(out.path / "src" / "sensor.h", given)
    found, status = run_fixed(out.path / "src" / "sensor.h", given)
    np.testing.assert_array_equal(board.words.astype(np.uint32).view(np.int32), found)
    np.testing.assert_array_equal(board.status, status)
    assert np.abs(number(found) - u).max() <= 2e-4
    assert board.cycles.max() <= 3000
    assert board.ram <= 1200


def slave(file: Path, folder: Path) -> Any:
    """An instance of an FMU, initialised at time 0."""
    import fmpy  # which only these tests need

    about = fmpy.read_model_description(file)
    unpacked = fmpy.extract(str(file), str(folder / "unpacked"))
    made = {"2.0": fmpy.fmi2.FMU2Slave, "3.0": fmpy.fmi3.FMU3Slave}[about.fmiVersion](
        guid=about.guid, unzipDirectory=unpacked, instanceName="it",
        modelIdentifier=about.coSimulation.modelIdentifier,
    )  # fmt: skip
    made.instantiate()
    if about.fmiVersion == "2.0":
        made.setupExperiment(startTime=0.0)
    made.enterInitializationMode()
    made.exitInitializationMode()
    return made


def stepped_fmu(made: Any, t: np.ndarray, y: np.ndarray, c: np.ndarray | None) -> np.ndarray:
    """Estimates, deviations and statuses, (samples, 3)."""
    two = hasattr(made, "getReal")
    get, put = (made.getReal, made.setReal) if two else (made.getFloat64, made.setFloat64)
    whole = made.getInteger if two else made.getInt32
    found = []
    for k, time in enumerate(t):
        put([1], [y[k]])
        if c is not None:
            put([5], [c[k]])
        made.doStep(currentCommunicationPoint=time, communicationStepSize=0.01)
        found.append([*get([2, 3]), *whole([4])])
    return np.array(found)


@pytest.mark.parametrize(
    ("name", "target"), [("creep", "fmu"), ("relays", "fmu3"), ("conditioned", "fmu")]
)
@JUDGES["FMPy"].needed
def test_an_fmu_is_valid_and_gives_the_estimates_of_the_header(name: str, target: str, tmp_path):
    """Bit for bit, NaN among the readings; a state that was kept, serialised or reset gives them again."""
    from fmpy.validation import validate_fmu  # which only this test needs

    one, file = case(name), fmu(name, target, tmp_path)
    assert validate_fmu(str(file)) == []
    y, t = with_gaps(one.y), one.t
    value, status, off = one.reference(tmp_path).run_with_deviation(one.dt, y, one.c)
    wanted = np.column_stack([value, off, status])
    made, half = slave(file, tmp_path), len(t) // 2
    first = stepped_fmu(made, t[:half], y[:half], one.c)
    three = target == "fmu3"
    kept = made.getFMUState() if three else made.getFMUstate()
    bytes_ = made.serializeFMUState(kept) if three else made.serializeFMUstate(kept)
    rest = one.c if one.c is None else one.c[half:]
    second = stepped_fmu(made, t[half:], y[half:], rest)
    np.testing.assert_array_equal(np.vstack([first, second]), wanted)
    (made.setFMUState if three else made.setFMUstate)(kept)
    np.testing.assert_array_equal(stepped_fmu(made, t[half:], y[half:], rest), wanted[half:])
    made.reset()
    again = made.deserializeFMUState(bytes_) if three else made.deSerializeFMUstate(bytes_)
    (made.setFMUState if three else made.setFMUstate)(again)
    np.testing.assert_array_equal(stepped_fmu(made, t[half:], y[half:], rest), wanted[half:])
    made.reset()
    np.testing.assert_array_equal(stepped_fmu(made, t[:half], y[:half], one.c), wanted[:half])
    made.terminate()
    made.freeInstance()


@JUDGES["FMPy"].needed
def test_an_fmu_is_its_sources_and_runs_in_fmpy(tmp_path: Path):
    """Compiled again by FMPy from the sources alone; small; the same bytes every time."""
    import fmpy  # which only these tests need

    file = fmu("creep", "fmu", tmp_path)
    with zipfile.ZipFile(file) as archive:
        binary = [i for i in archive.infolist() if i.filename.startswith("binaries/")]
        sizes = [sum(i.compress_size for i in them) for them in (archive.infolist(), binary)]
        rest = sizes[0] - sizes[1]
        assert "resources/hysid-export.json" in archive.namelist()
    assert len(binary) == 1
    assert rest < 100_000
    whole = file.read_bytes()
    assert fmu("creep", "fmu", tmp_path).read_bytes() == whole
    one, times = case("creep"), 0.02 * np.arange(50)
    kinds = [("time", float), ("reading", float)]
    table = np.array(list(zip(times, one.y[:50], strict=True)), dtype=kinds)
    found = fmpy.simulate_fmu(str(file), input=table, stop_time=0.98, output_interval=0.02)
    assert found.dtype.names == ("time", "estimate", "deviation", "status")
    assert np.isfinite(found["estimate"][1:]).all()


ROS_MAIN = """
#include <cstdio>
#include <cstdlib>
#include <cstring>

#include "filter.cpp"

int main(int, char **argv)
{
    double t, y, c, out;
    sensor::Scalar one;
    sensor::Wrench six;
    filters::FilterBase<double> &scalar = one; // as a chain has them
    filters::FilterBase<geometry_msgs::msg::WrenchStamped> &wrench = six;
    std::map<std::string, std::string> given = {{"condition_topic", "c"}, {"reset_service", "r"}};
    if (!std::strcmp(argv[1], "scalar")) {
        given["period"] = "0.02";
        if (!scalar.configure("it", given)) {
            return 1;
        }
    } else {
        given["force.z.enabled"] = "true";
        given["force.z.scale"] = "0.5";
        given["force.z.offset"] = "1";
        if (!wrench.configure("it", given)) {
            return 1;
        }
    }
    geometry_msgs::msg::WrenchStamped in, done;
    in.wrench.torque.x = 7;
    while (std::scanf("%lf %lf %lf", &t, &y, &c) == 3) {
        rclcpp::Node::last->publish(c);
        if (t < 0) {
            rclcpp::Node::last->call();
            continue;
        }
        if (!std::strcmp(argv[1], "scalar")) {
            scalar.update(y, out);
        } else {
            in.header.stamp.sec = static_cast<int>(t);
            in.header.stamp.nanosec = static_cast<unsigned>((t - static_cast<int>(t)) * 1e9 + 0.5);
            in.wrench.force.z = 2 * (y - 1);
            wrench.update(in, done);
            out = done.wrench.torque.x == 7 ? done.wrench.force.z : NAN;
        }
        std::printf("%a\\n", out);
    }
}
"""


@JUDGES["g++"].needed
@pytest.mark.parametrize(
    ("name", "kind"), rest_thorough([("creep", "wrench"), ("relays", "scalar")], 1)
)
def test_ros_plugins_give_the_estimates_of_the_header(name: str, kind: str, tmp_path: Path):
    """Beside stubs of ROS, with parameters by axis, stamps and the reset service."""
    one = case(name)
    out = one.write("ros2", tmp_path / "sensor")
    (tmp_path / "main.cpp").write_text(ROS_MAIN)
    command = ["g++", "-std=c++17", "-Wall", "-Wextra", "-Werror", "-O0", "-ffp-contract=off"]
    command += ["-I", str(ROOT / "tests" / "stubs"), "-I", str(out / "src"), "main.cpp", "-pthread"]
    assert ran(*command, "-o", "it", cwd=tmp_path).stderr == ""
    t = np.round(one.t[:150] + 1.0, 6)  # a stamp of 0 is none
    y = 1 + np.round(with_gaps(one.y[:150]) * 2**20) / 2**20
    rows = [f"{a!r} {b!r} 0" for a, b in zip(t.tolist(), y.tolist(), strict=True)]
    said = "\n".join([*rows, "-1 0 0", *rows]).replace("nan", "NAN")
    done = subprocess.run([tmp_path / "it", kind], input=said, capture_output=True, text=True)
    found = np.array([float.fromhex(x) for x in done.stdout.split()])
    dt = np.full(150, 0.02) if kind == "scalar" else np.diff(t, prepend=t[0])
    value, _ = one.reference(tmp_path).run(dt, y)
    wanted = np.concatenate([value, value])
    if kind == "wrench":  # a stamp has nanoseconds
        np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-6 * np.ptp(one.u))
    else:
        np.testing.assert_array_equal(found, wanted)


def test_a_ros_package_is_whole(tmp_path: Path):
    """Its files name each other, and the plugins the classes of the source."""
    out = case("conditioned").write("ros2", tmp_path / "sensor")
    described = ElementTree.parse(out / "plugins.xml").getroot()
    source = (out / "src" / "filter.cpp").read_text()
    for plugin in described.iter("class"):
        name, base = plugin.attrib["type"], plugin.attrib["base_class_type"]
        assert f"PLUGINLIB_EXPORT_CLASS({name}, {base})" in source
    needed = {e.text for e in ElementTree.parse(out / "package.xml").getroot().iter("depend")}
    build = (out / "CMakeLists.txt").read_text()
    assert needed == set(build.split("set(DEPENDENCIES ")[1].split(")")[0].split())
    assert "condition_topic" in (out / "config" / "filters.yaml").read_text()
    assert "CAUTION" in (out / "README.md").read_text()


SIMULATED = """
<mujoco>
  <option timestep="0.02" integrator="{integrator}"/>
  <extension>
    <plugin plugin="hysid.{stem}">
      <instance name="it"><config key="reading" value="given"/>{condition}</instance>
      <instance name="acting">{condition}</instance>
    </plugin>
  </extension>
  <worldbody>
    <body><joint name="a" type="slide"/><geom size="0.1"/></body>
    <body pos="1 0 0"><joint name="b" type="slide"/><geom size="0.1"/></body>
  </worldbody>
  <actuator><plugin joint="b" plugin="hysid.{stem}" instance="acting"/></actuator>
  <sensor>
    <jointpos name="given" joint="a"/>
    <plugin name="it" plugin="hysid.{stem}" instance="it"/>
  </sensor>
</mujoco>
"""


@JUDGES["MuJoCo"].needed
@pytest.mark.parametrize(("name", "integrator"), [("relays", "Euler"), ("creep", "RK4")])
def test_a_mujoco_plugin_gives_the_estimates_of_the_header(name: str, integrator: str, tmp_path):
    """As sensor and actuator; a second forward changes nothing, a saved state gives the same again."""
    import mujoco  # which only this test needs

    one, stem = case(name), f"tried_{name}"
    out = one.write("mujoco", tmp_path / stem)
    mujoco.mj_loadPluginLibrary(str(out / f"lib{stem}.so"))
    text = SIMULATED.format(stem=stem, integrator=integrator, condition="")
    model = mujoco.MjModel.from_xml_string(text)
    data, y = mujoco.MjData(model), one.y[:80]

    def stepped(readings: np.ndarray) -> np.ndarray:
        found = []
        for reading in readings:
            data.qpos[0], data.qvel[0], data.ctrl[0] = reading, 0.0, reading
            mujoco.mj_forward(model, data)
            mujoco.mj_step(model, data)
            found.append([*data.sensordata[1:4], data.actuator_force[0]])
        return np.array(found)

    dt = np.diff(np.concatenate([[0.0], np.add.accumulate(np.full(79, 0.02))]), prepend=0.0)
    value, status, off = one.reference(tmp_path).run_with_deviation(dt, y)
    wanted = np.column_stack([value, off, status, value])
    first = stepped(y[:40])
    kind = mujoco.mjtState.mjSTATE_INTEGRATION
    kept = np.empty(mujoco.mj_stateSize(model, kind))
    mujoco.mj_getState(model, data, kept, kind)
    np.testing.assert_array_equal(np.vstack([first, stepped(y[40:])]), wanted)
    mujoco.mj_setState(model, data, kept, kind)
    np.testing.assert_array_equal(stepped(y[40:]), wanted[40:])
    mujoco.mj_resetData(model, data)
    np.testing.assert_array_equal(stepped(y[:40]), wanted[:40])


@JUDGES["MuJoCo"].needed
def test_mujoco_runs_the_example(tmp_path: Path):
    import mujoco  # which only this test needs

    out = case("conditioned").write("mujoco", tmp_path / "tried_example")
    mujoco.mj_loadPluginLibrary(str(out / "libtried_example.so"))
    model = mujoco.MjModel.from_xml_path(str(out / "example.xml"))
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data)
    assert np.isfinite(data.sensordata[2])


MEMORY = "the estimate depends on the readings before"
CHECKED = f"""
import sys
import numpy as np
import pandas
from sklearn.utils.estimator_checks import check_estimator
from sensor import Compensator

failing = dict.fromkeys(
    ("check_methods_sample_order_invariance", "check_methods_subset_invariance"), {MEMORY!r}
)
made = check_estimator(Compensator(), expected_failed_checks=failing, on_skip=None)
assert len(made) > 30
X = np.load("given.npy")
one = Compensator(reading=1, time=0, condition=2, output="all").fit(X)
np.save("found.npy", one.transform(X))
named = pandas.DataFrame(X, columns=["t", "y", "c"])
by_name = one.set_params(reading="y", time="t", condition="c").fit(named)
np.testing.assert_array_equal(by_name.transform(named), np.load("found.npy"))
for wrong, options, said in ((X[::-1], {{}}, "in row 1 of X"), (X, {{"reading": 3}}, "reading=3")):
    try:
        Compensator(**{{"reading": 1, "time": 0, **options}}).fit(wrong).predict(wrong)
    except ValueError as error:
        assert said in str(error)
    else:
        raise AssertionError(said)
assert "jax" not in sys.modules and "compensate" not in sys.modules
"""


@JUDGES["scikit-learn"].needed
@pytest.mark.parametrize("name", ["creep"])
def test_an_estimator_passes_the_checks_of_sklearn(name: str, tmp_path: Path):
    """All but those that a model with memory cannot pass; in a process without hysid. Then the header's
    estimates bit for bit."""
    one = case(name)
    one.write("sklearn", tmp_path / "sensor")
    y = with_gaps(one.y)
    c = np.zeros(len(y)) if one.c is None else one.c
    np.save(tmp_path / "given.npy", np.column_stack([one.t, y, c]))
    (tmp_path / "checked.py").write_text(CHECKED)
    ran(sys.executable, "-W", "error", "checked.py", cwd=tmp_path)
    found = np.load(tmp_path / "found.npy")
    value, status, off = one.reference(tmp_path).run_with_deviation(one.dt, y, one.c)
    np.testing.assert_array_equal(found, np.column_stack([value, off, status]))


def in_onnx(name: str, n: int, folder: Path) -> tuple[dict[str, str], np.ndarray, np.ndarray]:
    """Metadata; estimate, deviation and status of n readings with gaps, and those of the header."""
    import onnxruntime  # which only these tests need

    one = case(name)
    file = one.write("onnx", folder / "sensor.onnx")
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    session = onnxruntime.InferenceSession(str(file), options, ["CPUExecutionProvider"])
    facts = session.get_modelmeta().custom_metadata_map
    state = np.array(json.loads(facts["initial_state"]))
    y = with_gaps(one.y)[:n]
    names, found = {i.name for i in session.get_inputs()}, []
    for reading, dt in zip(y, one.dt[:n], strict=True):
        given = {"reading": reading, "dt": dt, "state": state}
        fed = {key: np.asarray(value) for key, value in given.items() if key in names}
        *said, state = session.run(None, fed)
        found.append([float(x) for x in said])
    value, status, off = one.reference(folder).run_with_deviation(one.dt[:n], y)
    return facts, np.array(found), np.column_stack([value, off, status])


@JUDGES["onnxruntime"].needed
@pytest.mark.parametrize("name", ["relays", "creep", "sum"])
def test_an_onnx_step_gives_the_estimates_of_the_header(name: str, tmp_path: Path):
    """Bit for bit, state and all; its metadata say where it begins, and what it was made from."""
    facts, found, wanted = in_onnx(name, 60, tmp_path)
    assert json.loads(facts["hysid-export.json"])["origin"]["sha256"] == ORIGIN.sha256
    np.testing.assert_array_equal(found, wanted)


@JUDGES["onnxruntime"].needed
def test_an_onnx_step_has_functions_that_onnx_lacks(tmp_path: Path):
    """log1p and expm1 from Log and Exp: of the header's estimates to some roundings of theirs."""
    _, found, wanted = in_onnx("duhem", 60, tmp_path)
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-12 * np.nanmax(wanted[:, 0]))
