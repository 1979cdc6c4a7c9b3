"""Models that are not ours: fitted beside ours, saved and loaded, whatever their class is called."""

import json
import subprocess
import sys
from concurrent.futures import ProcessPoolExecutor
from inspect import unwrap
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

import hysteresis
from hysteresis import InputError, Record, load_model, register, save_model
from hysteresis._registry import OURS, class_of, find_model, known_models, model_names, registered
from identify import fit, fit_many, load, save
from tests.other_models import Gain, Line, Preisach, Unregistered, Weighted
from tests.refusals import raises, refuses

OUR_MODELS = [one for one in known_models() if one.kind.__module__.startswith(OURS)]

QUICK: dict[str, Any] = {"noise": "gaussian", "starts": 2}


def record(slope: float = 2.0) -> Record:
    u = np.tile(np.concatenate([np.linspace(0, 4, 20), np.linspace(4, 0, 20)]), 4)
    noise = np.random.default_rng(0).normal(0, 0.01, len(u))
    return Record.from_arrays(u, slope * u + 1 + noise, time=np.arange(len(u), dtype=float))


def fault(model: Any) -> InputError:
    """Why nothing can be fitted to two rows: because of the model, or else of the rows."""
    with pytest.raises(InputError) as caught:
        # As users call it: tests check the types of calls besides.
        unwrap(fit)(Record.from_arrays([0.0, 1.0], [0.0, 1.0], [0.0, 1.0]), model)
    return caught.value


def names() -> list[str]:
    """Every name that `fit` takes."""
    return fault("nothing").problem.removesuffix(".").partition("have ")[2].split(", ")


def test_names_and_models_are_ranked_together():
    ranked = fit(record(), ["linearsponge", Line(1.0), "gain"], **QUICK)
    assert {c.name for c in ranked.candidates} == {"LinearSponge", "Line", "Gain"}
    assert ranked.name != "Gain"  # a line through the origin
    assert type(fit(record(), Line, **QUICK).model) is Line


@pytest.mark.parametrize(("model", "code", "words"), [
    ("Presiach", "unknown-model", "did you mean Preisach?"),
    ("burgrs", "unknown-model", "did you mean Burgers?"),
    ([Line(1.0), 3], "not-a-model", "3 is not a model"),
    (int, "not-a-model", "is not a model"),
    ([], "unknown-model", "no model is named"),
    ("Weighted", "no-start-values", "nothing says where a fit of Weighted starts"),
    (Weighted, "no-start-values", "guess"),
    (Unregistered, "no-start-values", "guess"),
])  # fmt: skip
def test_what_cannot_be_fitted_is_refused(model: Any, code: str, words: str):
    found = fault(model)
    assert found.code == code
    assert words in str(found)


@pytest.mark.parametrize("name", [one.name for one in OUR_MODELS])
def test_every_model_of_ours_has_a_name_or_says_what_to_fit(name: str):
    found = fault(name)
    if name in names() and found.code != "no-start-values":
        return
    assert found.code == "no-start-values"
    instead = found.fix.removeprefix("fit ").split("(")[0].split(",")[0].split(".")[0]
    assert fault(instead).code not in ("no-start-values", "unknown-model")


def test_a_class_named_as_ours_is_theirs():
    found = fit(record(), Preisach(1.0), **QUICK)
    assert type(found.model) is Preisach
    assert type(found.model) is not hysteresis.Preisach
    assert float(found.model.slope) == pytest.approx(2.0, abs=0.02)
    own = type("Composition", (Preisach,), {})
    assert type(fit(record(), own(1.0), **QUICK).model) is own


def test_a_name_is_given_once():
    refuses("name-taken", lambda: register(Preisach, name="burgers"))
    assert registered(Preisach) == find_model("theirpreisach")
    assert class_of("hysteresis:Preisach") is hysteresis.Preisach
    assert "TheirPreisach" not in names()  # nothing says where its fit starts
    first = "Preisach EverettSurface Composition Butterfly LinearSponge Burgers FoamCurve"
    assert names()[:7] == first.split()


def test_a_registered_model_comes_back(tmp_path: Path):
    made = fit(record(), [Preisach(1.0)], **QUICK)
    assert made.name == "TheirPreisach"
    again = load(save(made, tmp_path / "fit"))
    assert type(again.model) is Preisach
    np.testing.assert_array_equal(again.predict(record()), made.predict(record()))


def test_an_unregistered_model_is_refused_before_anything_is_written(tmp_path: Path):
    made = fit(record(), Unregistered(1.0), **QUICK)
    before = save(fit(record(), "LinearSponge", **QUICK), tmp_path / "fit")
    kept = {file.name: file.read_bytes() for file in before.iterdir()}
    with raises("unregistered-class", "register(Unregistered)"):
        save(made, tmp_path / "fit", overwrite=True)
    assert {file.name: file.read_bytes() for file in before.iterdir()} == kept


def test_every_part_of_a_model_comes_back(tmp_path: Path):
    model = Weighted(
        (Gain(2.0), Line(1.0)), np.arange(3), -np.inf, ("a", 1, None), {"k": [1.5, True]},
        Pair(1, 2.0),
    )  # fmt: skip
    again = load_model(save_model(model, tmp_path / "model.json"))
    assert eqx.tree_equal(again, model)
    assert again.options == model.options
    assert isinstance(again.options["k"], list)
    assert type(again.pair) is Pair


@register
class Pair(NamedTuple):
    """A part that is not a module."""

    a: int
    b: float


def read(structure: dict[str, Any], arrays: dict[str, float], folder: Path) -> Any:
    """The model of a file that somebody wrote by hand."""
    document = {"structure": structure, "arrays": {
        name: {"type": "float64", "shape": [], "values": [value]} for name, value in arrays.items()
    }}  # fmt: skip
    (folder / "own.json").write_text(json.dumps(document))
    return load_model(folder / "own.json")


def test_what_is_read_is_checked(tmp_path: Path):
    words = json.loads(save_model(Gain(2.0), tmp_path / "gain.json").read_text())["structure"]
    assert read(words, {"slope": 3.0}, tmp_path) == Gain(3.0)
    refuses("gain-zero", lambda: read(words, {"slope": 0.0}, tmp_path))
    for fields in ({"k": 1}, {}):
        with pytest.raises(InputError, match="damaged-file"):
            read(words | {"fields": fields}, {"slope": 2.0}, tmp_path)
    with pytest.raises(InputError, match="cannot be kept in a file"):
        save_model(Weighted((), np.arange(3), 0.0, (jnp.tanh,)), tmp_path / "odd.json")


@pytest.mark.parametrize("key", ["os:system", "os.system", "builtins:eval", "hysteresis:Nothing"])
def test_nothing_but_what_is_registered_is_made(key: str, tmp_path: Path):
    refuses("unknown-model", lambda: read({"class": key, "fields": {}}, {}, tmp_path))


def test_fits_of_earlier_versions_are_read(tmp_path: Path):
    """Bare names, fields beside the class, tuples as lists."""
    arrays = {f"parts.{k}.{name}": v for k in (0, 1) for name, v in
              (("K", 2.0), ("b", 1.0), ("threshold", -np.inf))}  # fmt: skip
    line = [
        {"class": "LinearSponge"}
        | {n: {"array": f"parts.{k}.{n}"} for n in ("K", "b", "threshold")}
        for k in (0, 1)
    ]
    model = read({"class": "Sum", "parts": line}, arrays, tmp_path)
    assert type(model) is hysteresis.Sum
    assert isinstance(model.parts, tuple)
    np.testing.assert_allclose(model.simulate(None, [1.0, 2.0]), [6.0, 10.0])


@pytest.fixture
def plugged(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An installed distribution with a model, as an installer leaves it."""
    (tmp_path / "acme_loops.py").write_text(
        "from tests.other_models import AbstractSlope\n"
        "from hysteresis import Scalar, parameter\n\n"
        "class AcmeSlope(AbstractSlope):\n"
        "    slope: Scalar = parameter(1.0)\n"
    )
    info = tmp_path / "acme_loops-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: acme-loops\nVersion: 1.0\n")
    points = "Acme = acme_loops:AcmeSlope\nBroken = acme_nowhere:Model\n"
    (info / "entry_points.txt").write_text(f"[hysid.models]\n{points}")
    monkeypatch.syspath_prepend(tmp_path)
    return tmp_path


def test_a_model_of_another_distribution_is_imported_when_it_is_named(plugged: Path):
    assert "acme_loops" not in sys.modules
    assert {"Acme", "Broken"} <= set(model_names())
    assert "acme_loops" not in sys.modules
    known = find_model("acme")
    assert known.name == "Acme"
    assert registered(known.kind) == known
    refuses("broken-plug-in", lambda: find_model("broken"))


@pytest.mark.thorough
def test_a_saved_fit_names_its_distribution(plugged: Path, tmp_path: Path):
    save(fit(record(), "Acme", **QUICK), tmp_path / "fit")
    script = "import jax, sys, identify; jax.config.update('jax_enable_x64', True); " + (
        "assert 'acme_loops' not in sys.modules; print(type(identify.load('fit').model))"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True,
        env={"PYTHONPATH": f"{plugged}:{Path(__file__).parents[3]}", "PATH": ""},
    )  # fmt: skip
    assert "acme_loops.AcmeSlope" in done.stdout, done.stderr


@pytest.mark.thorough
def test_many_fits_over_processes_keep_such_models(tmp_path: Path):
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        how = {"executor": pool, "starts": 2, "noise": "auto"}
        good = fit_many([record(1.0), record(2.0)], [Line(1.0)], **how)
        bad = fit_many([record()], Unregistered(1.0), executor=pool, starts=2, noise="auto")
    assert not good.failed
    assert [type(one.model) for _, one in good] == [Line, Line]
    (error,) = bad.failed.values()
    assert error.code == "unregistered-class"
