"""Training: what is learnt, that it is reproducible, and that a run can be stopped and resumed."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from hysteresis import InputError
from identify.internal import train
from tests.refusals import refuses

X = np.linspace(-1, 1, 200)
DATA = (X, 0.5 + 2.0 * X)
FAST = {"batch": 20, "epochs": 60, "learning_rate": 0.1}
"""What tests share: a loop is compiled once for all of them."""


class Line(eqx.Module):
    """y = a x + b, with a noise that only a training hears."""

    a: jax.Array
    b: jax.Array
    rough: float = 0.0
    inference: bool = False

    def __call__(self, x: jax.Array, key: jax.Array) -> jax.Array:
        noise = 0.0 if self.inference else self.rough * jax.random.normal(key, x.shape, x.dtype)
        return self.a * x + self.b + noise


def line(rough: float = 0.0) -> Line:
    return Line(jnp.asarray(0.0), jnp.asarray(0.0), rough)


def squares(module: Line, rows: tuple[jax.Array, jax.Array], key: jax.Array) -> jax.Array:
    return jnp.mean((module(rows[0], key) - rows[1]) ** 2)


def test_a_line_is_learnt_and_the_best_kept():
    found = train(line(), squares, DATA, **FAST)
    # Adam's steps of 0.1 circle the minimum; the best of 60 epochs is far closer than a step.
    assert abs(float(found.module.a) - 2) < 0.02
    assert abs(float(found.module.b) - 0.5) < 0.02
    assert found.stopped == "epochs"
    assert found.best == int(found.validation.argmin())
    assert len(found.train) == len(found.validation) == 60


def test_an_interrupted_run_goes_on_bit_for_bit(tmp_path):
    file = tmp_path / "run.npz"

    def interrupt(done: int, *_: object) -> None:
        if done >= 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train(line(0.1), squares, DATA, **FAST, checkpoint=file, progress=interrupt)
    rest = train(line(0.1), squares, DATA, **FAST, checkpoint=file, resume=True)
    whole = train(line(0.1), squares, DATA, **FAST)
    assert bool(eqx.tree_equal(rest.module, whole.module))
    np.testing.assert_array_equal(rest.train, whole.train)
    assert rest.said == ("resumed from run.npz.",)


def test_a_checkpoint_of_another_run_is_refused(tmp_path):
    file = tmp_path / "run.npz"
    train(line(), squares, DATA, **FAST, checkpoint=file)
    other = (X, DATA[1] + 1)
    with pytest.raises(InputError, match=r"another data.*other-checkpoint"):
        train(line(), squares, other, **FAST, checkpoint=file, resume=True)
    with pytest.raises(InputError, match="another seed"):
        train(line(), squares, DATA, **FAST, seed=1, checkpoint=file, resume=True)
    file.write_bytes(file.read_bytes()[:-40])
    with pytest.raises(InputError, match="damaged-file"):
        train(line(), squares, DATA, **FAST, checkpoint=file, resume=True)


def test_nothing_kept_begins_anew(tmp_path):
    file = tmp_path / "none.npz"
    found = train(line(), squares, DATA, **FAST, checkpoint=file, resume=True)
    assert found.said == ("no epochs were kept in none.npz, so the run began from the start.",)


@pytest.mark.parametrize(("code", "changed"), [
    ("length-mismatch", {"data": (X, X[1:])}), ("length-mismatch", {"data": (X[:0], X[:0])}),
    ("not-finite", {"data": (X, np.where(X > 0.9, np.nan, X))}), ("bad-option", {"batch": 0}),
    ("bad-option", {"epochs": 0}), ("bad-option", {"patience": 0}),
    ("bad-option", {"learning_rate": 0.0}), ("bad-option", {"validation": 1.0}),
    ("wrong-shape", {"validation": {"x": X}}), ("no-checkpoint", {"resume": True}),
    ("diverged", {"data": (X, 1e200 * X)}),
])  # fmt: skip
def test_bad_input_is_answered(code, changed):
    given = {"data": DATA, **FAST, **changed}
    data = given.pop("data")
    refuses(code, lambda: train(line(), squares, data, **given))


def test_a_module_without_weights_is_refused():
    class Nothing(eqx.Module):
        pass

    refuses("nothing-free", lambda: train(Nothing(), squares, DATA))
