"""Saved results with entries changed, removed or exchanged, and their checksums made again."""

import copy
import hashlib
import json
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np
from hypothesis import strategies as st

import identify
from compensate import Quantity, export_runtime
from compensate.internal import ForceEstimator, Readout
from compensate.microchannel import Localizer
from compensate.runtime import FileError, load
from compensate.runtime._file import checksum
from hysid.soft_sensor._sensor import ARRAYS, WORDS, SoftSensor, load_sensor, save_sensor
from hysteresis import GeneralizedMaxwell, InputError
from hysteresis._limits import parse_toml
from identify import load_posterior, save_posterior
from identify.internal import sealed, to_json
from tests.problems import INVERTIBLE
from tests.test_hysid.command import COLUMNS, put, run, sponge, text

from .._measure import Row, judged, noted
from .fuzzing import told
from .tables import broken

ODD: tuple[Any, ...] = (
    None, True, -1, 0, 10**9, 10**400, 1e308, "", "x", "\ud800", [], {}, [1, 2], {"a": 1}, [[[[]]]],
    "../../x", float("nan"), 2**63, "os.system",
)  # fmt: skip
TOML = """[selection]
input = "force (N)"
output = "displacement (mm)"
time = "time (s)"
test_cycles = 1

[fit]
model = "LinearSponge"
seed = 0

[parameters]
K = {start = 2.0, bounds = [0.1, 100.0]}
"""


class Edits(NamedTuple):
    """Which document, and for each edit: where (a number for each level) and what is put there."""

    which: int
    edits: list[tuple[list[int], int]]
    deep: int


edits = st.builds(
    Edits,
    st.integers(0, 10**6),
    st.lists(st.tuples(st.lists(st.integers(0, 10**6), min_size=1, max_size=6), st.integers(0, len(ODD))),
             min_size=1, max_size=3),
    st.integers(0, 60),
)  # fmt: skip


def changed(document: Any, case: Edits) -> Any:
    """A document after its edits."""
    document = copy.deepcopy(document)
    for steps, what in case.edits:
        at = document
        for depth, step in enumerate(steps):
            keys = list(at) if isinstance(at, dict) else list(range(len(at)))
            if not keys:
                break
            key = keys[step % len(keys)]
            inner = at[key]
            if depth < len(steps) - 1 and isinstance(inner, dict | list) and inner:
                at = inner
                continue
            if what == len(ODD):
                del at[key]
            else:
                at[key] = copy.deepcopy(ODD[what])
            break
    if case.deep == 0 and isinstance(document, dict):
        nest: Any = 1
        for _ in range(500):
            nest = [nest]
        document["deep"] = nest
    return document


PUT: tuple[Any, ...] = (None, True, "x", -1, 10**400, float("nan"), [], {}, [1, 2])
"""What is put in the place of every entry."""


def each_replaced(document: Any, put: Sequence[Any] = PUT) -> Iterator[tuple[str, bool, Any]]:
    """A document without each of its entries, or with something else there, in turn: where, whether that is
    of another kind than what was there, and the document. Of a list the first two entries."""
    for place in _places(document):
        for value in (PUT, *put):
            made = copy.deepcopy(document)
            at = made
            for key in place[:-1]:
                at = at[key]
            old = at[place[-1]]
            if value is PUT:
                del at[place[-1]]
            else:
                at[place[-1]] = value
            null = value is None or value != value or old is None  # NaN is written as null
            other = value is not PUT and not null and _kind(old) is not _kind(value)
            yield ".".join(map(str, place)), other, made


def _places(node: Any, at: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    for key in (
        node if isinstance(node, dict) else range(len(node[:2]) if isinstance(node, list) else 0)
    ):
        yield (*at, key)
        yield from _places(node[key], (*at, key))


def _kind(value: Any) -> type:
    number = isinstance(value, int | float) and not isinstance(value, bool)
    return float if number and abs(value) < float("inf") else type(value)


def fields(quick: bool) -> list[Row]:
    """Every entry of a fit.json and of runtime files, in turn taken away or of another kind."""
    put = PUT[2:3] if quick else PUT
    rows, every = [], 16 if quick else 4
    for what, tried in (
        ("fit.json", _fit_fields(put)),
        ("runtime files", _runtime_fields(put, every)),
    ):
        begin = time.process_time()
        ended = list(tried)
        wrong = [said for said in ended if said]
        for said in wrong[:20]:
            print(f"{what}: {said}", file=sys.stderr)
        took = time.process_time() - begin
        rows += [
            judged(f"{len(ended):,} changes of {what}: tracebacks, silently used", len(wrong), 0),
            noted("    seconds of processor time", took),
        ]  # fmt: skip
    return rows


def _told(fit: Any) -> dict[str, Any]:
    """What a fit says but what its command was asked for, which the command that reads it checks."""
    return to_json(replace(fit, asked={}))


def _fit_fields(put: Sequence[Any]) -> Iterator[str]:
    folder = small_fit()
    whole = json.loads((folder / "fit.json").read_text())
    same = _told(identify.load(folder))
    for place, other, made in each_replaced(whole, put):
        if place.partition(".")[0] in ("checksums", "files") or ".values" in place:
            continue  # which are no figures, and free
        (folder / "fit.json").write_text(json.dumps(sealed(made)))
        try:
            fit = identify.load(folder)
            used = _told(fit) != same
            str(fit)
        except InputError:
            used = False
        except Exception as error:
            yield f"{place}: {type(error).__name__} {error}"
            continue
        said = place.split(".")[-2:-1] in (
            ["reasons"],
            ["history"],
        )  # in earlier versions a sentence
        yield f"{place}: used" if used and other and not said else ""


def _runtime_fields(put: Sequence[Any], every: int) -> Iterator[str]:
    file = Path("it.json")
    for whole in exported(8, every):
        for place, other, made in each_replaced(whole, put):
            if place == "checksum":
                continue
            file.write_text(json.dumps(made | {"checksum": checksum(made)}))
            try:
                it = load(file)
                it.step(0.01, 0.5, 0.5)
                it.restore(it.state())
            except FileError:
                other = False
            except Exception as error:
                yield f"{whole['title']}, {place}: {type(error).__name__} {error}"
                continue
            yield f"{whole['title']}, {place}: used" if other else ""


def exported(readings: int = 40, every: int = 4) -> list[Any]:
    """Files of compensators of a quarter of the exportable models, as documents."""
    documents, file = [], Path("it.json")
    for problem in INVERTIBLE[::every]:
        t = np.linspace(0, 1, readings)
        u = problem.low + (problem.high - problem.low) * np.abs(np.sin(7 * t))
        y = np.asarray(problem.model().simulate(t, u))
        export_runtime(problem.model(), file, y, times=t)
        documents.append(json.loads(file.read_text()))
    return documents


def runtime_files() -> Callable[[Edits], str]:
    """Compensators of exportable models: `load` gives `FileError` or something that runs."""
    documents, file = exported(), Path("it.json")

    def tried(case: Edits) -> str:
        document = changed(documents[case.which % len(documents)], case)
        if isinstance(document, dict):
            document["checksum"] = checksum(document)
        file.write_text(json.dumps(document))
        try:
            it = load(file)
        except FileError:
            return "FileError"
        it.reset()
        return "read"

    return tried


def small_fit() -> Path:
    """The folder of a fit of a record of a few rows."""
    put(text(sponge(4.0)))
    words = ("--model", "LinearSponge", "--noise", "gaussian", "--starts", 2, "--out", "out")
    assert run("fit", "run.csv", *COLUMNS, *words).code == 0
    return Path("out")


def _damaged(whole: bytes, random: np.random.Generator) -> bytes:
    """Bytes of an archive or of an HDF5 file, some of them exchanged; half the time none."""
    content = bytearray(whole)
    if random.random() < 0.5:
        at = random.integers(0, len(content), random.integers(1, 6))
        for k in at:
            content[k] = random.integers(256)
        content = content[: int(at[0])] if random.random() < 0.2 else content
    return bytes(content)


def _put_damaged(folder: Path, document: Any, whole: dict[str, bytes], case: Edits) -> Any:
    """Write the files of a document, damaged; the document has their new checksums, most of the time."""
    random = np.random.default_rng(case.which)
    for name in whole:
        content = _damaged(whole[name], random)
        (folder / name).write_bytes(content)
        listed = document.get("files") if isinstance(document, dict) else None
        if isinstance(listed, dict) and case.which % 5:
            document["files"] = listed | {name: hashlib.sha256(content).hexdigest()}
    return document


def fits() -> Callable[[Edits], str]:
    """fit.json of a small fit and the arrays beside it, loaded; one in ten predicts its file."""
    folder = small_fit()
    names = ("data.npz", "fit.npz", "model.npz")
    whole = {name: (folder / name).read_bytes() for name in names}
    document = json.loads((folder / "fit.json").read_text())

    def tried(case: Edits) -> str:
        made = changed(document, case) if case.which % 3 else copy.deepcopy(document)
        for name in names:
            (folder / name).write_bytes(whole[name])
        if case.which % 2:
            made = _put_damaged(folder, made, whole, case)
        made = sealed(made) if isinstance(made, dict) and case.which % 8 else made
        (folder / "fit.json").write_text(json.dumps(made))
        if case.which % 10 == 0:
            ended = told(run("predict", folder, "run.csv"))
            for file in folder.glob("predicted-*"):
                file.unlink()
            return ended
        try:
            identify.load(folder)
        except InputError as error:
            return error.code
        return "read"

    return tried


def posteriors() -> Callable[[Edits], str]:
    """posterior.json, with damaged posterior.nc and posterior_models.npz beside it."""
    folder = small_fit()
    fit = identify.load(folder)
    save_posterior(identify.sample(fit, steps=40, ensembles=2), folder)
    names = ("posterior.nc", "posterior_models.npz")
    whole = {name: (folder / name).read_bytes() for name in names}
    document = json.loads((folder / "posterior.json").read_text())

    def tried(case: Edits) -> str:
        made = changed(document, case) if case.which % 3 else document
        made = _put_damaged(folder, made, whole, case)
        made = sealed(made) if isinstance(made, dict) else made
        (folder / "posterior.json").write_text(json.dumps(made))
        try:
            load_posterior(folder)
        except InputError as error:
            return error.code
        return "read"

    return tried


def sensors() -> Callable[[Edits], str]:
    """soft_sensor.json of a sensor of places and forces, with damaged arrays beside it."""
    random, folder = np.random.default_rng(0), Path("sensor")
    places = np.repeat(["A", "B"], 20)
    readings = np.where(places[:, None] == "A", (1.0, 0.2), (0.3, 1.0))
    readings = readings * (1 + 0.05 * random.normal(size=readings.shape))
    sensor = SoftSensor(
        (Quantity("layer 1", "V"), Quantity("layer 2", "V")), Readout(channels=2),
        localizer=Localizer.train(readings, places),
    )  # fmt: skip
    save_sensor(sensor, folder)
    force = SoftSensor(
        (Quantity("layer", "V"),), Readout(channels=1),
        force=ForceEstimator(GeneralizedMaxwell(1.0, [0.1], [2.0]), 0.05, 8.0),
    )  # fmt: skip
    save_sensor(force, "force")
    kept = [(json.loads((f / WORDS).read_text()), (f / ARRAYS).read_bytes())
            for f in (folder, Path("force"))]  # fmt: skip

    def tried(case: Edits) -> str:
        document, whole = kept[case.which % 2]
        made = changed(document, case) if case.which % 3 else copy.deepcopy(document)
        made = _put_damaged(folder, made, {ARRAYS: whole}, case)
        made = sealed(made) if isinstance(made, dict) else made
        (folder / WORDS).write_text(json.dumps(made))
        try:
            load_sensor(folder)
        except InputError as error:
            return error.code
        return "read"

    return tried


@st.composite
def configurations(draw: st.DrawFn) -> bytes:
    """A configuration with some lines exchanged, and bytes broken."""
    lines: list[str] = [*TOML.splitlines()]
    odd = (
        *(
            "[a.b",
            "x = [" + "[" * 200,
            "k" + ".k" * 300 + " = 1",
            "model = 1",
            "model = []",
            '"" = 1',
        ),
        *("seed = -1", "test_cycles = 1e400", "input = ['a', 2]", "K = {start = 'x'}", "K = 3"),
        *(
            "time = true",
            "x = 2024-01-01",
            "nan = nan",
            'input = "\\u0000"',
            "[[fit]]",
            "bounds = [2, 1]",
        ),
    )
    for _ in range(draw(st.integers(0, 3))):
        lines.insert(draw(st.integers(0, len(lines))), draw(st.sampled_from(odd)))
    return broken(draw, "\n".join(lines).encode())


def toml_files() -> Callable[[bytes], str]:
    """A configuration, checked and fitted with."""
    put(text(sponge()[:60]))

    def tried(content: bytes) -> str:
        Path("it.toml").write_bytes(content)
        return told(run("check", "run.csv", "--config", "it.toml"))

    return tried


def cases() -> Iterator[tuple[str, Any, Callable[[], Callable[[Any], str]], float]]:
    """What is tried, its cases, what tries them, and its share of the count."""
    jax.config.update("jax_enable_x64", True)
    assert parse_toml(TOML)
    yield "runtime files with entries changed", edits, runtime_files, 0.15
    yield "fits with entries and bytes changed", edits, fits, 0.05
    yield "posteriors with entries and bytes changed", edits, posteriors, 0.05
    yield "sensors with entries and bytes changed", edits, sensors, 0.15
    yield "configurations", configurations(), toml_files, 0.1
