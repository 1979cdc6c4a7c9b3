"""Readers of other packages in a process of their own, where memory and time have an end.

What a file asks for is not known before it is read: a workbook of 9 kB may span 17 thousand million cells,
and a damaged MAT-file ends the process that reads it.

    python _apart.py READER MEMORY < file > what `read(file, ...)` of the module READER makes of it
"""

import contextlib
import importlib
import subprocess
import sys
from pathlib import Path

MOST_MEMORY, LONGEST_S = 2 * 1024**3, 120
"""Bytes of a small file's reader, and seconds."""


def read_apart(reader: str, data: bytes, *limits: int) -> bytes:
    """What a module of this folder makes of a file's bytes.

    Raises `ValueError` where it fails, or needs more memory or time than it gets.
    """
    memory = max(MOST_MEMORY, 8 * len(data))
    command = [sys.executable, "-P", __file__, reader, *map(str, (memory, *limits))]
    try:
        done = subprocess.run(command, input=data, capture_output=True, timeout=LONGEST_S)
    except subprocess.TimeoutExpired:
        raise ValueError(f"reading it takes more than {LONGEST_S} s") from None
    if done.returncode == 1:
        raise ValueError(done.stderr.decode("utf-8", "replace").strip().splitlines()[-1])
    if done.returncode:
        raise ValueError(f"it takes more than {memory:,} bytes of memory, or ends its reader")
    return done.stdout


def _main(reader: str, memory: int, *limits: int) -> None:
    with contextlib.suppress(ImportError, ValueError):
        import resource  # Windows has none

        resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
    try:
        sys.path.append(str(Path(__file__).parent))  # behind all others: it has names of its own
        read = importlib.import_module(reader).read
        sys.stdout.buffer.write(read(sys.stdin.buffer.read(), *limits))
    except MemoryError:
        sys.exit(2)
    except BaseException as error:  # a panic of Rust is no Exception
        sys.exit(f"{error}" or type(error).__name__)


if __name__ == "__main__":
    _main(sys.argv[1], *map(int, sys.argv[2:]))
