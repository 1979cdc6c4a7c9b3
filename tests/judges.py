"""The judges of `hysid export --to`, simulators and importers: which are here. See `make targets`."""

import shutil
from importlib.util import find_spec
from typing import NamedTuple

import pytest


class Judge(NamedTuple):
    """What it judges, the commands and the modules it needs, and the packages that bring them."""

    targets: str
    commands: tuple[str, ...]
    modules: tuple[str, ...] = ()
    packages: str = "any C compiler"

    @property
    def missing(self) -> list[str]:
        """What is not here."""
        absent = [name for name in self.commands if shutil.which(name) is None]
        return absent + [name for name in self.modules if find_spec(name) is None]

    @property
    def needed(self) -> pytest.MarkDecorator:
        """Skips a test, visibly, where anything is missing."""
        return pytest.mark.skipif(bool(self.missing), reason=f"no {', '.join(self.missing)}")


JUDGES = {
    "gcc": Judge("c", ("gcc",)),
    "g++": Judge("arduino, ros2: compiled beside stubs", ("g++",), packages="any C++ compiler"),
    "FMPy": Judge("fmu, fmu3", ("gcc",), ("fmpy",), "pip: FMPy"),
    "MuJoCo": Judge("mujoco", ("gcc",), ("mujoco",), "pip: mujoco"),
    "scikit-learn": Judge("sklearn", (), ("sklearn",), "pip: scikit-learn"),
    "onnxruntime": Judge("onnx", (), ("onnx", "onnxruntime"), "pip: onnx onnxruntime"),
    "simavr": Judge("arduino", ("avr-gcc", "simavr"), packages="apt: simavr gcc-avr avr-libc"),
    "QEMU": Judge(
        "arduino", ("arm-none-eabi-gcc", "qemu-system-arm"),
        packages="apt: gcc-arm-none-eabi libnewlib-arm-none-eabi qemu-system-arm",
    ),
}  # fmt: skip

if __name__ == "__main__":
    for name, judge in JUDGES.items():
        said = (
            f"missing: {', '.join(judge.missing)} ({judge.packages})" if judge.missing else "here"
        )
        print(f"{name:12} {judge.targets:40} {said}")
