"""What bad input does: to the command line, to damaged files, to a running compensator; what a kill leaves.

python -m benchmarks.ruggedness [--quick] [--json] [--only TEXT] [--count N] [--seed K]
                                [--python PATH]

Parts: files (the table of bad inputs), damage (a good file, damaged at random), folders (a fit's files,
damaged at random), readings (compensators fed with what a broken sensor gives), tables (structured fuzzing
of text tables, TDMS, workbooks and MAT-files), documents (the same of saved results and configurations),
bombs (small files that unpack, repeat or declare much), makers (files of makers, damaged at random),
fields (every entry of a fit.json and of runtime files left out or of another kind),
guided (bytes of tables, runtime files, fits and configurations that atheris makes, guided by coverage),
names (hostile names of columns), headers (exported C fed with broken numbers), numbers (fits in other
units, moved far off, made again), zeros (tares, jumps, drifts and losses of the zero put into good
records), interpreters (outputs and fits with two threads, and by another Python),
load (rows, columns, groups, steps in C, threads, processes), disk (a full one), kills (at random moments;
who lives on after SIGTERM and SIGKILL; two writers of a folder, folders that vanish or are read-only),
chains (of killed samplers, resumed), http (the studio: wrong requests, many at once, other ports).

`--count`: of cases of `tables`, `documents` and `guided`, 10,000 each by default; `--seed`: other cases, so
that 200,000 are tried by several processes. `--python`: the other Python, of an environment that has hysid,
hypothesis and pytest; without it one is made below build/ where another Python is found.
"""

import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path

import jax
import numpy as np

from compensate import Status, export_runtime, invert
from compensate.runtime import load
from tests.problems import INVERTIBLE, SAMPLES, Problem, clock, random_histories
from tests.test_hysid.command import COLUMNS, put, run, sponge, text, tree
from tests.test_hysid.test_cli.test_bad_inputs import BAD
from tests.test_hysid.test_cli.test_bad_inputs_table import TABLE

from ._identification.sampling import kill_rows
from ._measure import Row, judged, noted, run_parts
from ._ruggedness import bombs as _bombs
from ._ruggedness import coverage_guided as _coverage_guided
from ._ruggedness import documents as _documents
from ._ruggedness import http as _http
from ._ruggedness import interpreters as _interpreters
from ._ruggedness import kills as _kills
from ._ruggedness import load as _load
from ._ruggedness import numbers as _numbers
from ._ruggedness import tables as _tables
from ._ruggedness import written as _written
from ._ruggedness import zeros as _zeros
from ._ruggedness.fuzzing import elsewhere, fuzz, one_line

FIT = ("--model", "LinearSponge", "--noise", "gaussian", "--starts", 2, "--out", "out")
WORDS = (
    b"NaN",
    b"inf",
    b"-inf",
    b"1e999",
    b"1e200",
    b"OVLD",
    b"",
    b"1,5",
    b'"',
    b"0x1F",
    "°".encode(),
    b"-",
)
BROKEN = (np.nan, np.inf, -np.inf)


def files(quick: bool) -> list[Row]:
    """Every file of the tests' tables; every sixth for `quick`, as the tests try all of them."""
    table = dict([*(BAD | TABLE).items()][:: 6 if quick else 1])
    with elsewhere():
        answered = 0
        for bad in table.values():
            put(bad.content)
            options = bad.options if "--model" in bad.options else (*bad.options, *FIT[:2])
            said = run("fit", "run.csv", *options, "--out", "out")
            whole = f"[{bad.code}]" in said.err and all(word in said.err for word in bad.words)
            answered += one_line(said) and whole and not Path("out").exists()
    what = f"bad inputs answered with exit 2, one line, its code, its words, of {len(table)}"
    return [judged(what, answered, len(table), at_least=True)]


def damaged(data: bytes, random: np.random.Generator) -> bytes:
    """A file after one to three accidents."""
    for _ in range(random.integers(1, 4)):
        data = ACCIDENTS[random.integers(len(ACCIDENTS))](data, random)
    return data


def _cut(data: bytes, random: np.random.Generator) -> bytes:
    a, b = np.sort(random.integers(0, len(data) + 1, 2))
    return (data[:a], data[a:], data[a:b], data[:a] + data[b:])[random.integers(4)]


def _swapped_bytes(data: bytes, random: np.random.Generator) -> bytes:
    raw = np.frombuffer(data, np.uint8).copy()
    at = random.integers(0, max(len(raw), 1), random.integers(1, 9))
    if len(raw):
        raw[at] = random.integers(0, 256, at.size) if random.random() < 0.5 else raw[at][::-1]
    return raw.tobytes()


def _repeated_lines(data: bytes, random: np.random.Generator) -> bytes:
    lines = data.splitlines(keepends=True) or [b""]
    a, b = np.sort(random.integers(0, len(lines) + 1, 2))
    part = lines[a:b] * int(random.integers(0, 3))
    return b"".join(lines[:a] + part + lines[b:])


def _column_lost(data: bytes, random: np.random.Generator) -> bytes:
    rows = [line.split(b",") for line in data.split(b"\n")]
    k, first = random.integers(4), random.integers(2) * random.integers(len(rows))
    return b"\n".join(
        b",".join(r[:k] + r[k + 1 :] if i >= first else r) for i, r in enumerate(rows)
    )


def _other_separators(data: bytes, random: np.random.Generator) -> bytes:
    old, new = (b",.;\n\t"[k : k + 1] for k in random.integers(0, 5, 2))
    return data.replace(old, new, random.choice([-1, 1, 7]))


def _odd_cells(data: bytes, random: np.random.Generator) -> bytes:
    rows = [line.split(b",") for line in data.split(b"\n")]
    for _ in range(random.integers(1, 6)):
        row = rows[random.integers(len(rows))]
        row[random.integers(len(row))] = WORDS[random.integers(len(WORDS))]
    return b"\n".join(map(b",".join, rows))


ACCIDENTS = (_cut, _swapped_bytes, _repeated_lines, _column_lost, _other_separators, _odd_cells)


def damage(quick: bool) -> list[Row]:
    """A good file after accidents, looked at by `hysid check`."""
    count, good = 60 if quick else 2000, text(sponge()).encode()
    random, seen, wrong = np.random.default_rng(0), Counter[str](), []
    with elsewhere():
        for _ in range(count):
            content = damaged(good, random)
            put(content)
            said = run("check", "run.csv", *COLUMNS)
            fine = said.code == 0 and not said.err
            seen[said.err.rpartition("[")[2].strip("]\n") if said.code else "read"] += 1
            if not (fine or one_line(said)):
                wrong.append(said.err)
    for said in wrong[:3]:
        print(said, file=sys.stderr)
    what = f"a good file damaged at random: neither read nor refused in one line, of {count:,}"
    return [
        judged(what, len(wrong), 0),
        noted("kinds of refusal among them", len(seen) - ("read" in seen)),
        noted("of them read, in percent", 100 * seen["read"] / count),
    ]


def folders(quick: bool) -> list[Row]:
    """A fit's files after accidents, one file at a time, run over the file it was fitted to."""
    count, random, wrong = 12 if quick else 400, np.random.default_rng(1), 0
    with elsewhere():
        put(text(sponge()))
        assert run("fit", "run.csv", *COLUMNS, *FIT).code == 0
        whole = tree(Path("out"))
        names = sorted(whole)
        for k in range(count):
            name = names[k % len(names)]
            content = damaged(whole[name], random)
            put(content, f"out/{name}")
            said = run("predict", "out", "run.csv")
            same = content == whole[name] or name == "fit.json"
            wrong += not (one_line(said) or (said.code == 0 and same))
            for file in Path("out").glob("*.csv"):
                file.unlink()
            put(whole[name], f"out/{name}")
    what = f"a fit's files damaged at random: neither refused in one line nor harmless, of {count}"
    return [judged(what, wrong, 0)]


def readings(quick: bool) -> list[Row]:
    """A fifth of the readings of every model is broken; for those exported one is huge besides."""
    tried = INVERTIBLE[::17] if quick else INVERTIBLE
    found = [_fed(problem) for problem in tried]
    exceptions, poisoned = sum(f[0] for f in found), sum(f[1] for f in found)
    differ = max(f[2] for f in found)
    with tempfile.TemporaryDirectory() as folder:
        own = [p for p in tried if p in INVERTIBLE]
        exported = [_fed_exported(problem, Path(folder) / "it.json") for problem in own]
    return [
        judged(f"{len(found)} compensators fed with NaN and infinities: exceptions", exceptions, 0),
        judged("... estimates that are not finite or not marked INVALID", poisoned, 0),
        judged("... estimates beside a record without them, of the range", differ, 1e-9),
        judged(
            f"{len(own)} exported ones, 1e300 too: exceptions, estimates not finite",
            sum(e[0] for e in exported), 0,
        ),
        judged("... beside readings at the limit instead, of the range", max(e[1] for e in exported), 1e-9),
    ]  # fmt: skip


def _history(problem: Problem) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, inputs and outputs of a model."""
    model = problem.model()
    u = random_histories(np.random.default_rng(0), problem.low, problem.high, (1, SAMPLES))[0]
    step = 0.1 * np.diff(clock(0), prepend=0.0)
    if getattr(model, "hold", "") == "constant":
        step = np.minimum(step, 0.2 * float(model.largest_stable_step()))  # type: ignore[attr-defined]
    t = np.cumsum(step)
    return t, u, np.asarray(model.simulate(t, u))


def _broken(y: np.ndarray) -> np.ndarray:
    hole = np.random.default_rng(2).random(len(y)) < 0.2
    hole[0] = hole[5:8] = True
    return hole


def _fed(problem: Problem) -> tuple[int, int, float]:
    """Exceptions; estimates that are not finite or not marked; largest difference of the good ones."""
    t, u, y = _history(problem)
    hole, compensator = _broken(y), invert(problem.model())
    fed = np.where(hole, np.random.default_rng(3).choice(BROKEN, len(y)), y)
    try:
        value, status = map(np.asarray, compensator.simulate(t, fed)[:2])
        alone = np.asarray(compensator.simulate(t[~hole], y[~hole]).value)
    except Exception as error:
        print(f"{problem.name}: {error}", file=sys.stderr)
        return 1, 0, 0.0
    bad = ~np.isfinite(value) | ((status == Status.INVALID) != hole)
    return 0, int(bad.sum()), float(np.abs(value[~hole] - alone).max() / np.ptp(u))


def _fed_exported(problem: Problem, path: Path) -> tuple[int, float]:
    """Exceptions and estimates that are not finite; largest difference to readings at the limit."""
    t, u, y = _history(problem)
    export_runtime(problem.model(), path, y, times=t, depth=4 * SAMPLES)
    compensator, step = load(path), np.diff(t, prepend=t[0]).tolist()
    hole, huge = _broken(y), np.zeros(len(y), bool)
    huge[[12, 25]] = True
    fed = np.where(hole, np.random.default_rng(3).choice(BROKEN, len(y)), y)
    spiked, limited = np.where(huge, 1e300, fed), np.where(huge, compensator.limits[1], fed)
    try:
        value = np.array(
            [compensator.step(*x).value for x in zip(step, spiked.tolist(), strict=True)]
        )
        compensator.reset()
        same = np.array(
            [compensator.step(*x).value for x in zip(step, limited.tolist(), strict=True)]
        )
    except Exception as error:
        print(f"{problem.name}: {error}", file=sys.stderr)
        return 1, 0.0
    return int((~np.isfinite(value)).sum()), float(np.abs(value - same).max() / np.ptp(u))


def tables(count: int, first: int) -> list[Row]:
    """Structured cases of text tables, and damaged binary ones, through `hysid check`."""
    with elsewhere():
        rows = fuzz(_tables.texts(), int(0.35 * count), _tables.checked, first).rows("text tables")
        good = _tables.good_binaries()
        what = f"damaged {', '.join(sorted(good))} files"
        return rows + fuzz(_tables.binaries(good), int(0.15 * count), _tables.checked, first).rows(
            what
        )


def documents(count: int, first: int) -> list[Row]:
    """Saved results and configurations with entries changed."""
    rows = []
    for what, cases, make, share in _documents.cases():
        with elsewhere():
            rows += fuzz(cases, max(int(share * count), 10), make(), first).rows(what)
    return rows


def _in_a_folder(part: Callable[[bool], list[Row]]) -> Callable[[bool], list[Row]]:
    def inside(quick: bool) -> list[Row]:
        with elsewhere():
            return part(quick)

    return inside


def kills(quick: bool) -> list[Row]:
    """Kills of commands, eight of each, and of their processes, and folders that others change."""
    if quick:
        return [noted("kills of commands", 0, reason="takes minutes: run without --quick")]
    with elsewhere():
        return _kills.kills(64) + _kills.children(2) + _kills.folders_changed(5)


def chains(quick: bool) -> list[Row]:
    """Chains of samplers that were killed and resumed."""
    if quick:
        return [noted("killed chains", 0, reason="takes minutes: run without --quick")]
    return kill_rows(quick)


def disk(quick: bool) -> list[Row]:
    """Commands on a full disk; the same for `quick`."""
    with elsewhere():
        return _kills.full_disk()


def http(quick: bool) -> list[Row]:
    """The server of the studio."""
    with elsewhere():
        return _http.rows(200 if quick else 3000, 0)


def numbers(quick: bool) -> list[Row]:
    """Fits of a record in other units, moved far off, and made again."""
    if quick:
        return [noted("numbers in other units", 0, reason="takes a minute: run without --quick")]
    with elsewhere():
        return _numbers.equivariance() + _numbers.repetition()


def much(quick: bool) -> list[Row]:
    """Large tables, many steps, threads and processes."""
    if quick:
        return [noted("load", 0, reason="takes minutes: run without --quick")]
    with elsewhere():
        rows = _load.large_files() + _load.many_steps() + _load.monitored()
    return rows + _load.at_once()  # other processes import from where this one does


FUZZED, QUICKLY = 10_000, 100
"""Cases of `tables` and `documents`."""

PARTS: dict[str, Callable[[bool], list[Row]]] = {
    "files": files,
    "damage": damage,
    "folders": folders,
    "readings": readings,
    "names": lambda quick: _written.hostile_names(100 if quick else 500),
    "bombs": _in_a_folder(_bombs.bombs),
    "makers": _in_a_folder(_bombs.mutated),
    "fields": _in_a_folder(_documents.fields),
    "headers": lambda quick: _written.headers(17 if quick else 1),
    "http": http,
    "numbers": numbers,
    "zeros": _zeros.rows,
    "load": much,
    "disk": disk,
    "kills": kills,
    "chains": chains,
}


def main(arguments: Sequence[str] | None = None) -> None:
    """Run every part and print."""
    # Commands run in this process, and nothing that they do may write outside of their folder.
    jax.config.update("jax_enable_compilation_cache", False)
    given = list(sys.argv[1:] if arguments is None else arguments)
    own = {"--count": "0", "--seed": "0", "--python": ""}
    for name in own:
        if name in given:
            at = given.index(name)
            own[name], given = given[at + 1], [*given[:at], *given[at + 2 :]]
    count, first = int(own["--count"]), int(own["--seed"])

    def of(part: Callable[[int, int], list[Row]]) -> Callable[[bool], list[Row]]:
        return lambda quick: part(count or (QUICKLY if quick else FUZZED), first)

    def interpreters(quick: bool) -> list[Row]:
        if quick:
            return [noted("other interpreters", 0, reason="takes minutes: run without --quick")]
        return _interpreters.rows(own["--python"])

    parts = PARTS | {
        "tables": of(tables),
        "documents": of(documents),
        "guided": of(_coverage_guided.rows),
        "interpreters": interpreters,
    }
    run_parts("benchmarks.ruggedness", __doc__, parts, given)


if __name__ == "__main__":
    main(sys.argv[1:])
