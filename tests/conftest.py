"""One thread per process, double precision, strict arrays, checked shapes, fixed seeds."""

import gc
import os
import sys
from functools import cache
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from typing import Any
from unittest.mock import patch

import pytest
from hypothesis import settings

from tests.checked_calls import install

# Inherited by pytest's workers and our subprocesses, where thread pools would only get into each
# other's way. For this process it is late: pytest's plugins have loaded NumPy.
for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")
os.environ.setdefault("JAX_PLATFORMS", "cpu")
os.environ["JAX_ENABLE_COMPILATION_CACHE"] = "0"  # commands would fill the developer's home
# Compiling is most of the tests' time; with less optimisation the suite takes six tenths of it. The first
# flag is a third of that, and newer versions abort at it. A program in one piece, not in up to 32, takes
# half of the memory maps and a seventh less time.
_older = tuple(int(part) for part in version("jaxlib").split(".")[:2]) < (0, 11)
os.environ.setdefault(
    "XLA_FLAGS",
    ("--xla_cpu_use_fusion_emitters=false" if _older else "")
    + " --xla_cpu_multi_thread_eigen=false --xla_cpu_parallel_codegen_split_count=1"
    " --xla_backend_optimization_level=0 --xla_llvm_disable_expensive_passes=true",
)
os.environ["MPLBACKEND"] = "Agg"  # no window, no display
# Without bytecode every process would compile our sources again: of collecting the tests three tenths.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False
_PACKAGES = ("hysteresis", "identify", "compensate", "hysid")
if early := set(_PACKAGES) & set(sys.modules):
    raise RuntimeError(f"{sorted(early)} imported before their types could be checked")
# Laws and `compensate.runtime`, which runs them, have no arrays, and steps would take ten times as long.
_PLAIN = (["compensate", "runtime"], ["hysteresis", "laws"])
install(lambda name: name.split(".")[0] in _PACKAGES and name.split(".")[:2] not in _PLAIN)

import jax  # noqa: E402
from jax._src.interpreters import mlir  # noqa: E402
from matplotlib.figure import Figure  # noqa: E402

from hysteresis.numerics import _compiled  # noqa: E402

# MLIR takes 4 ms to make a context, a fifth of what an operation takes to compile. One serves all programs.
if hasattr(mlir, "make_ir_context"):  # private, and may go
    mlir.make_ir_context = cache(mlir.make_ir_context)

# Traces are many objects and few cycles. A collector that looks at them as often as by default takes
# a twentieth of the suite's time.
gc.set_threshold(100_000, 50, 100)

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_rank_promotion", "raise")
jax.config.update("jax_numpy_dtype_promotion", "strict")

settings.register_profile(
    "hysid",
    deadline=None,  # the first example compiles
    derandomize=True,
    max_examples=20,
    print_blob=True,
)
settings.load_profile("hysid")


def _folder(variable: str, name: str, said: str, key: str = "") -> Path:
    """What is shared beside the checkout, or where a variable says that it is."""
    named = os.environ.get(variable)
    folder = Path(named) if named else Path(__file__).resolve().parents[2] / "shared" / name
    if not (folder / key).exists():
        pytest.skip(f"no {said} at {folder}; name their folder in {variable}")
    return folder


@pytest.fixture(scope="session")
def measured_data() -> Path:
    """Folder of real measurements by third parties, which the repository may not contain."""
    return _folder("HYSID_DATA", "data", "measured data")


@pytest.fixture(scope="session")
def vendor_files() -> Path:
    """Folder of files as makers of rigs wrote them, with their right answers in `key.json`."""
    return _folder("HYSID_VENDOR", "vendor", "files of makers", "key.json")


@pytest.fixture
def duhem(monkeypatch: pytest.MonkeyPatch) -> Any:
    """A model of the template distribution."""
    monkeypatch.syspath_prepend(Path(__file__).parents[1] / "docs" / "template")
    return import_module("hysid_duhem").Duhem(0.5, 1.0, 0.7)


@pytest.fixture(scope="session", autouse=True)
def coarse_pictures():
    """Pictures of an eighth of their density: drawn as ever, a tenth of a second less each to pack."""
    save = Figure.savefig
    with patch.object(Figure, "savefig", lambda *to, **how: save(*to, **how | {"dpi": 24})):
        yield


@pytest.fixture(scope="session", autouse=True)
def known_latency():
    """To be timed, a compensator's step is compiled twice and taken 2000 times, or for a second."""
    from compensate._qualification import Latency  # late: xdist's own process needs it not

    slow = Latency(median=1e-5, tail=1e-2, steps=2000)
    with patch("compensate._qualification.latency", lambda *_: slow):
        yield


@pytest.fixture(scope="module", autouse=True)
def forget_compiled():
    """Programs and traces are kept for the next module while there is room for them."""
    yield
    _compiled.forget_compiled()
    gc.freeze()
