"""The Arduino library: an example that compiles, and the same estimates on a simulated ATmega328."""

import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from compensate import export_to
from compensate.runtime import load
from hysteresis import InputError
from tests.boards import AVR, on_avr
from tests.targets import MAKERS, ORIGIN, case

ROOT = Path(__file__).parents[2]
every = pytest.mark.parametrize("name", MAKERS)


@every
@pytest.mark.skipif(shutil.which("g++") is None, reason="no g++")
def test_the_example_compiles(name: str, tmp_path: Path):
    out = case(name).write("arduino", tmp_path / "sensor")
    example = out / "examples" / "Compensate" / "Compensate.ino"
    stub = ROOT / "tests" / "sketches"
    command = ["g++", "-x", "c++", "-std=c++11", "-Wall", "-Wextra", "-Werror", "-fsyntax-only"]
    command += ["-I", str(stub), "-I", str(out / "src"), str(example)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")


def test_the_library_carries_the_fit(tmp_path: Path):
    one = case("relays")
    out = one.write("arduino", tmp_path / "sensor")
    runtime = load(out / "hysid-export.json")
    assert runtime.origin == {**ORIGIN._asdict(), "codes": ["flat"]}
    assert runtime.trained == (one.u.min(), one.u.max())
    properties = dict(
        line.split("=", 1) for line in (out / "library.properties").read_text().splitlines()
    )
    assert properties["name"] == json.loads((out / "library.json").read_text())["name"] == "sensor"
    assert (out / "src" / properties["includes"]).is_file()
    for text in (out / "README.md", out / "src" / "sensor.h"):
        for fact in ("CAUTION", "2024-05-03", 64 * "a", "A sponge & its <skin>", "mm", "force"):
            assert fact in text.read_text()


def test_a_folder_is_replaced_only_where_an_export_wrote_it(tmp_path: Path):
    one = case("creep")
    one.write("arduino", tmp_path / "sensor")
    (tmp_path / "sensor" / "old").write_text("")
    one.write("arduino", tmp_path / "sensor")
    assert not (tmp_path / "sensor" / "old").exists()
    assert [p.name for p in tmp_path.iterdir()] == ["sensor"]
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.tex").write_text("")
    with pytest.raises(InputError, match="no export has written") as error:
        one.write("arduino", tmp_path / "mine")
    assert error.value.code == "would-overwrite"
    for name in ("1st", "a-b"):
        with pytest.raises(InputError, match="cannot be the name"):
            one.write("arduino", tmp_path / name)
    for target, real in (("plc", None), ("arduino", "double")):
        with pytest.raises(InputError) as error:
            export_to(target, one.model, tmp_path / "it", one.y, real=real)
        assert error.value.code == "bad-option"


@pytest.mark.skipif(not AVR, reason="no avr-gcc and simavr")
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
