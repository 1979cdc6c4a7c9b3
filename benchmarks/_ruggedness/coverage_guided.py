"""Bytes that atheris makes of good files, guided by the lines of hysid that each of them reaches.

python -m benchmarks._ruggedness.coverage_guided KIND COUNT SEED tries cases of one kind in the current
folder, and prints how they ended.

atheris instruments what is imported after it and does not come back, so that each kind is a process.
"""

import contextlib
import importlib.util
import json
import os
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

from .._measure import Row, noted

KINDS = ("tables", "runtime files", "fits", "configurations")
PACKAGES = ["hysteresis", "hysid", "identify", "compensate", "nptdms"]
"""What is instrumented."""

ENDINGS = ("csv", "txt", "lvm", "tdms", "xlsx", "xls", "xlsb", "mat", "uff", "parquet")
LONGEST = 16_384
"""Bytes of a case."""

ROOT = Path(__file__).parents[2]
ON_PATH = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
RESULT = "ended: "
HOW = "needs atheris: pip install 'hysid[fuzz]'"

Tried = tuple[Callable[[bytes], str], list[bytes]]
"""What tries a case, and good ones to begin with."""


def rows(count: int, seed: int) -> list[Row]:
    """`count` cases, as many of each kind."""
    if importlib.util.find_spec("atheris") is None:
        return [noted("cases guided by coverage", 0, reason=HOW)]
    from .fuzzing import Tally, elsewhere  # the process of a kind imports it behind atheris

    found = []
    for kind in KINDS:
        with elsewhere():
            words = [kind, str(max(count // len(KINDS), 1)), str(seed)]
            run = subprocess.run(
                [sys.executable, "-m", "benchmarks._ruggedness.coverage_guided", *words],
                env=os.environ | {"PYTHONPATH": ON_PATH},
                capture_output=True, text=True, errors="replace", check=False,
            )  # fmt: skip
        lines = [line for line in run.stdout.splitlines() if line.startswith(RESULT)]
        tally = Tally()
        if lines:
            told = json.loads(lines[-1].removeprefix(RESULT))
            tally = Tally(Counter(told["ended"]), told["failures"], told["slowest"])
        else:  # the process has ended itself
            tally.failures.append(run.stderr)
        found += tally.rows(f"{kind}, bytes guided by coverage")
    return found


def _tables() -> Tried:
    """`hysid check` of a file: two bytes choose its ending and its options, the others are its content."""
    from tests.test_hysid.command import F, X, sponge, text

    from . import tables

    names = (("--input", "force", "--output", "x"), ("--input", F, "--output", X))

    def tried(data: bytes) -> str:
        ending, how = (*data[:2], 0, 0)[:2]
        more = tables.OPTIONS[how // 2 % len(tables.OPTIONS)] if how % 4 == 3 else ()
        case = tables.Case(data[2:], ENDINGS[ending % len(ENDINGS)], (*names[how % 2], *more))
        return tables.checked(case)

    rows = sponge()
    plain = text(rows[:20]).encode()
    report = ("Test: 5\nOperator: me\n\n" + text(rows[:9], separator="\t")).encode()
    first = [bytes([ENDINGS.index(k), 0]) + whole for k, whole in tables.good_binaries().items()]
    first += [bytes([ENDINGS.index("csv"), 1]) + plain, bytes([ENDINGS.index("txt"), 1]) + report]
    return tried, first


def _runtime_files() -> Tried:
    """A compensator's file; what is JSON has its checksum made again."""
    from compensate.runtime import FileError, load
    from compensate.runtime._file import checksum

    from .documents import exported

    file = Path("it.json")

    def tried(data: bytes) -> str:
        file.write_bytes(
            _sealed(data, lambda document: document | {"checksum": checksum(document)})
        )
        try:
            load(file).reset()
        except FileError:
            return "FileError"
        return "read"

    return tried, [json.dumps(document).encode() for document in exported()]


def _fits() -> Tried:
    """fit.json of a small fit; what is JSON has its checksum made again."""
    import identify
    from hysteresis import InputError
    from identify.internal import sealed

    from .documents import small_fit

    folder = small_fit()
    file = folder / "fit.json"

    def tried(data: bytes) -> str:
        file.write_bytes(_sealed(data, sealed))
        try:
            identify.load(folder)
        except InputError as error:
            return error.code
        return "read"

    return tried, [file.read_bytes()]


def _configurations() -> Tried:
    from .documents import TOML, toml_files

    return toml_files(), [TOML.encode()]


def _sealed(data: bytes, seal: Callable[[dict[str, Any]], dict[str, Any]]) -> bytes:
    try:
        document = json.loads(data)
        return json.dumps(seal(document)).encode() if isinstance(document, dict) else data
    except (ValueError, RecursionError):
        return data


MAKERS: dict[str, Callable[[], Tried]] = dict(
    zip(KINDS, (_tables, _runtime_files, _fits, _configurations), strict=True)
)


def main(kind: str, count: int, seed: int) -> None:
    """Try cases of one kind, and end the process."""
    atheris: Any = importlib.import_module("atheris")  # an extra
    with atheris.instrument_imports(include=PACKAGES):
        import jax

        jax.config.update("jax_enable_x64", True)
        from .fuzzing import judging

        run, good = MAKERS[kind]()
        # What is imported late and done once; atheris says on stderr what it instruments.
        for content in good:
            with contextlib.suppress(AssertionError):
                run(content)
    kept, done = contextlib.ExitStack(), 0
    corpus = kept.enter_context(tempfile.TemporaryDirectory())
    each, tally = kept.enter_context(judging(run))
    for k, content in enumerate(good):
        Path(corpus, str(k)).write_bytes(content)

    def one(data: bytes) -> None:
        nonlocal done
        each(data)
        done += 1
        if done == count:
            kept.close()
            told = {"ended": tally.ended, "failures": tally.failures, "slowest": tally.slowest}
            print(RESULT + json.dumps(told), flush=True)
            os._exit(0)  # libFuzzer does not come back

    limits = [f"-max_len={LONGEST}", "-rss_limit_mb=0", "-timeout=0", f"-seed={seed + 1}"]
    atheris.Setup([sys.argv[0], *limits, corpus], one)
    atheris.Fuzz()


if __name__ == "__main__":
    main(sys.argv[1], *map(int, sys.argv[2:]))
