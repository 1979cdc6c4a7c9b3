"""Exported headers, compiled and run from Python."""

import ctypes
import hashlib
import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np

Arrays = tuple[np.ndarray, ...]
STRICT = ("-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Werror")


def checksum(document: dict[str, Any]) -> str:
    """Of a runtime file: SHA-256 of its JSON in order and without blanks, but for the checksum itself."""
    rest = {key: value for key, value in document.items() if key != "checksum"}
    text = json.dumps(rest, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()


COMPILERS = [name for name in ("gcc", "clang") if shutil.which(name)]

SOURCE = """\
#include "{stem}.h"

typedef {stem}_real real;

void run(long n, const double *dt, const double *y, const double *c, double *u, double *off, int *status);
void predict(long n, const double *dt, const double *u, const double *c, double *y);
int wrong(void);
int size(void);

void run(long n, const double *dt, const double *y, const double *c, double *u, double *off, int *status)
{{
    {stem}_state s;
    {stem}_reset(&s);
    (void)dt;
    (void)c;
    for (long k = 0; k < n; ++k) {{
        real value, deviation;
        status[k] = {stem}_step(&s, (real)dt[k], (real)y[k], {c}&value, &deviation);
        u[k] = (double)value;
        off[k] = (double)deviation;
    }}
}}

void predict(long n, const double *dt, const double *u, const double *c, double *y)
{{
    {stem}_state s;
    {stem}_reset(&s);
    (void)dt;
    (void)c;
    for (long k = 0; k < n; ++k) {{
        y[k] = {predict};
    }}
}}

int wrong(void)
{{
    {stem}_state s;
    return {stem}_self_test(&s);
}}

int size(void)
{{
    return (int)sizeof({stem}_state);
}}
"""

LEARNING = """
void learn(
    long n, const double *dt, const double *y, const double *known, double *u, double *lost, int *advice);

void learn(
    long n, const double *dt, const double *y, const double *known, double *u, double *lost, int *advice)
{{
    {stem}_state s;
    {stem}_reset(&s);
    for (long k = 0; k < n; ++k) {{
        real value;
        (void){stem}_learn(&s, (real)dt[k], (real)y[k], (real)known[k], &value, 0);
        u[k] = (double)value;
        lost[k] = (double){stem}_lost(&s);
        advice[k] = {stem}_advice(&s);
    }}
}}
"""


def ran(*command: str | Path, **options: Any) -> subprocess.CompletedProcess[str]:
    """A command that succeeded: its words are what it said."""
    done = subprocess.run(command, capture_output=True, text=True, **options)
    assert done.returncode == 0, done.stderr
    return done


class Compiled:
    """A header `stem`.h as a shared library."""

    def __init__(self, header: Path, compiler: str = "gcc", flags: tuple[str, ...] = ("-O2",)):
        self.text, stem = header.read_text("utf-8"), header.stem
        c = "(real)c[k], " if f"{stem}_real condition" in self.text else ""
        known = f"double {stem}_predict(" in self.text.replace(f"{stem}_real", "double")
        held = c and ", (real)c[k]"
        back = f"(double){stem}_predict(&s, (real)dt[k], (real)u[k]{held})"
        predict = back if known else "u[k]"
        source = header.with_suffix(".c")
        code = SOURCE + (LEARNING if f"{stem}_learn(" in self.text else "")
        source.write_text(code.format(stem=stem, c=c, predict=predict), "utf-8")
        library = header.with_suffix(f".{compiler}.so")
        paths = [str(source), "-o", str(library), "-lm"]
        ran(compiler, *STRICT, *flags, "-shared", "-fPIC", *paths)
        self.library = ctypes.CDLL(str(library))

    def run(self, dt: np.ndarray, y: np.ndarray, c: np.ndarray | None = None) -> Arrays:
        """Estimates and statuses; `c`: the condition, where the header asks for one."""
        return self.run_with_deviation(dt, y, c)[:2]

    def run_with_deviation(self, dt: Any, y: np.ndarray, c: np.ndarray | None = None) -> Arrays:
        """And the deviations."""
        c = np.zeros(len(y)) if c is None else c
        u, off, status = np.empty(len(y)), np.empty(len(y)), np.empty(len(y), np.int32)
        self.library.run(ctypes.c_long(len(y)), *map(_pointer, (dt, y, c, u, off, status)))
        return u, status, off

    def learn(self, dt: np.ndarray, y: np.ndarray, known: np.ndarray) -> Arrays:
        """Estimates, accuracy lost and advice of a compensator that learns; `known`: inputs, or NaN."""
        u, lost, advice = np.empty(len(y)), np.empty(len(y)), np.empty(len(y), np.int32)
        pointers = map(_pointer, (dt, y, known, u, lost, advice))
        self.library.learn(ctypes.c_long(len(y)), *pointers)
        return u, lost, advice

    def predict(self, dt: np.ndarray, u: np.ndarray, c: np.ndarray | None = None) -> np.ndarray:
        """Readings of the model itself."""
        y = np.empty(len(u))
        c = np.zeros(len(u)) if c is None else c
        self.library.predict(ctypes.c_long(len(u)), *map(_pointer, (dt, u, c, y)))
        return y

    @property
    def wrong(self) -> int:
        """What the self test counts."""
        return self.library.wrong()

    @property
    def size(self) -> int:
        """sizeof of the state."""
        return self.library.size()


def _pointer(array: np.ndarray) -> Any:
    assert array.flags.c_contiguous
    return array.ctypes.data_as(ctypes.c_void_p)
