"""The short ways in: arrays, data frames, models at `hysid`, one HTML file, double precision."""

import copy
import inspect
import pickle
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import compensate
import hysid
import hysteresis
import identify
from hysteresis import AbstractModel, InputError, LinearSponge, Record, Series, Sum
from identify.internal import train
from tests.refusals import refuses
from tests.test_hysid.command import write

U = np.concatenate([np.linspace(0, 20, 60), np.linspace(20, 0, 60)] * 3)
Y = 2.0 * U + 1 + 0.01 * np.sin(np.arange(len(U)) * 7.0)
UNITS: dict[str, Any] = {"input_unit": "N", "output_unit": "mm"}
HOW: dict[str, Any] = {"model": "LinearSponge", "noise": "gaussian", "starts": 2}


class Frame:
    """What pandas and polars have in common: names in `columns`, and a column by its name."""

    def __init__(self, columns: dict[str, Any]):
        self.data, self.columns = columns, list(columns)

    def __getitem__(self, name: str) -> Any:
        return self.data[name]


def test_fit_takes_arrays_frames_mappings_and_files(tmp_path: Path):
    columns = {"force (N)": U.tolist(), "x_mm": Y}
    whole = hysid.fit(U, Y, **UNITS, **HOW)
    file = write(tmp_path / "run.csv", columns)
    for data in (columns, Frame(columns), file, str(file)):
        found = hysid.fit(data, input="force (N)", output="x_mm", **HOW)
        assert found.parameters[0].value == whole.parameters[0].value
        assert (found.train.input_unit, found.train.output_unit) == ("N", "mm")
    record = Record.from_arrays(U, Y, **UNITS)
    again = hysid.fit(record, "LinearSponge", noise="gaussian", starts=2)
    assert again.parameters == whole.parameters


@pytest.mark.parametrize(("call", "code"), [
    (lambda: hysid.fit(U), "bad-option"),
    (lambda: hysid.fit(Record.from_arrays(U, Y), input="u", output="y"), "bad-option"),
    (lambda: hysid.fit({"u": U, "y": Y}, input="v", output="y"), "no-column"),
    (lambda: hysid.fit({"u": U, "y": [[1, 2]]}, input="u", output="y"), "given-twice"),
    (lambda: hysid.fit({"u": U}.get("v"), Y), "length-mismatch"),
    (lambda: hysid.fit([], []), "too-few-rows"),
])  # fmt: skip
def test_fit_says_how_to_call_it(call: Any, code: str):
    refuses(code, call)


def test_a_record_called_wrongly_says_what_to_call():
    record: Any = Record
    for arguments in ((), (U, Y), ("run.csv",)):
        with pytest.raises(InputError, match=r"Record.from_arrays"):
            record(*arguments)


def test_compositions_take_models_or_a_list():
    line = LinearSponge(K=2.0, b=1.0, threshold=0.0)
    u = np.array([1.0, 2.0])
    for kind in (Series, Sum):
        one, other = kind(line, line), kind([line, line])
        assert len(one.parts) == 2
        np.testing.assert_array_equal(one.simulate(None, u), other.simulate(None, u))
        assert len(kind(kind(line, line), line).parts) == 3
        assert kind(parts=(line,)).parts == kind(line).parts
        refuses("bad-parts", kind)


def test_every_model_is_at_hysid():
    models = {
        name
        for name, value in vars(hysteresis).items()
        if inspect.isclass(value)
        and issubclass(value, AbstractModel)
        and not inspect.isabstract(value)
    }
    assert models <= set(dir(hysid))
    assert all(getattr(hysid, name) is not None for name in dir(hysid))


def test_the_first_call_works_and_leaves_the_precision_of_jax():
    u = [0.0, 1.0, 2.0, 3.0] * 20
    law = hysteresis.BoucWen(2.0, 0.3, 0.4)  # which JAX calls back in threads of its own
    quick: dict[str, Any] = {"noise": "gaussian", "starts": 2}
    jax.config.update("jax_enable_x64", False)  # of all threads, as in a process that says nothing
    try:
        fit = hysid.fit(u, [2 * x for x in u], "LinearSponge", **quick)
        assert fit["K"].value == pytest.approx(2, abs=1e-12)
        assert fit.predict([1.5]) == pytest.approx([3], abs=1e-12)
        fit = hysid.fit(u, law.simulate(None, u), "BoucWen", **quick)
        assert fit.metrics["train"].nrmse_percent < 1e-3
        assert jnp.zeros(1).dtype == "float32"
        hysid.enable_x64()
        assert jnp.zeros(1).dtype == "float64"
    finally:
        jax.config.update("jax_enable_x64", True)


def _used(folder: Path, name: str) -> dict[str, Any]:
    """What comes of a fit in JAX's present precision."""
    record = Record.from_arrays(U, Y, np.arange(len(U)), **UNITS)
    fit = hysid.fit(record, name, noise="gaussian", starts=2)
    saved = folder / f"{name}-{jnp.zeros(1).dtype}"
    hysid.save(fit, saved)
    state, stepped = fit.model.init(), []
    for t, u in zip(range(9), U[:9], strict=True):
        state, y = fit.model.step(state, t, u)
        stepped.append(y)
    compensator = hysid.invert(fit)
    _, first = compensator.step(compensator.init(), 0.0, Y[5])
    made = hysid.invert(hysid.load(saved))
    with ThreadPoolExecutor(2) as threads:
        many = hysid.fit_many({"one": record}, name, clocks="auto", executor=threads)
    known = {"trained": fit.trained, "times": record.time}
    compensate.export_runtime(fit.model, saved / "it.json", Y, **known)
    assert fit.plot().axes
    return {
        "parameters": [p.value for p in fit.parameters], "covariance": fit.covariance,
        "predicted": fit.predict(record), "model": fit.model.simulate(record.time, U),
        "stream": fit.model.stream(record.time, U)[1], "stepped": np.array(stepped),
        "inverse": compensator.simulate(record.time, Y), "first": first,
        "loaded": made.simulate(record.time, Y), "many": many.fits["one"].predict(record),
    }  # fmt: skip


@pytest.mark.thorough
def test_what_is_made_of_a_fit_is_the_same_in_single_precision(tmp_path: Path):
    double = _used(tmp_path, "Preisach")
    with jax.enable_x64(False):
        single = _used(tmp_path, "Preisach")
        assert jnp.zeros(1).dtype == jnp.float32
    for a, b in zip(jax.tree.leaves(double), jax.tree.leaves(single), strict=True):
        assert np.asarray(b).dtype == np.asarray(a).dtype
        np.testing.assert_array_equal(a, b)


def test_a_program_in_single_precision_is_told_the_cure(tmp_path: Path):
    with jax.enable_x64(False):
        fit = hysid.fit(U, Y, **UNITS, **HOW)
        for program in (
            lambda u: fit.model.simulate(None, u),
            lambda u: fit.model.step(fit.model.init(), 0.0, u[0])[1],
            lambda u: hysid.invert(fit.model).simulate(None, u).value,
        ):
            for run in (jax.jit, jax.vmap):
                with pytest.raises(InputError) as caught:
                    run(program)(jnp.ones((3, 3)))
                assert (caught.value.code, caught.value.fix) == (
                    "single-precision", "hysid.enable_x64()",
                )  # fmt: skip
        compensator = hysid.invert(fit)
        for kept in (pickle.loads(pickle.dumps(compensator)), copy.deepcopy(compensator)):
            assert {x.dtype for x in jax.tree.leaves(kept)} == {np.dtype("float64")}
        own = LinearSponge(K=2.0, b=1.0)  # the user's own model stays what it is
        assert pickle.loads(pickle.dumps(own)).K.dtype == copy.copy(own).K.dtype == jnp.float32
        assert jax.jit(lambda u: own.simulate(None, u))(U).dtype == jnp.float32
        with pytest.raises(InputError, match="enable_x64"):
            train(own, lambda *_: jnp.zeros(()), (U,), epochs=1)
        rough = identify.fit(fit.train, "LinearSponge", allow_float32=True, starts=2)
        loaded = hysid.load(hysid.save(fit, tmp_path / "it"))
        kinds = [jax.tree.leaves(one.model)[0].dtype for one in (rough, loaded)]
        assert kinds == [jnp.float32, jnp.float64]
