"""Comparing models of one record: signs, chance, criteria and evidence against exact answers."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.stats

from hysteresis import InputError, LinearSponge
from identify import FitResult, compare, fit, save
from identify.internal import Compared, Comparison, compare_candidates, target
from tests.refusals import raises, refuses
from tests.test_identify.lines import line, pressed


def model(name: str, blocks: np.ndarray) -> Compared:
    return Compared(name, "LinearSponge", float(np.sqrt(blocks.mean())), None, 2, blocks=blocks)


def test_equal_models_are_told_apart_one_time_in_twenty() -> None:
    """Blocks of thirty rows: 2,000 pairs, so 0.05 to three times 0.005; the t is not quite one."""
    random = np.random.default_rng(0)
    a, b = random.chisquare(30, (2, 2000, 10))
    clear = []
    for one, other in zip(a, b, strict=True):
        pair = Comparison((model("a", one), model("b", other)), "held-out", ()).pairs[0]
        clear.append(pair.held_out.clear)
    assert 0.035 < np.mean(clear) < 0.065


def test_words_say_who_is_better_or_that_nobody_knows() -> None:
    good, noisy = np.full(10, 1.0), np.linspace(0.5, 1.5, 10)
    comparison = Comparison((model("a", good), model("b", 4 * good + 0.1 * noisy)), "held-out", ())
    assert comparison.words[0].startswith("a predicts held-out rows better than b by 1 ±")
    comparison = Comparison((model("a", good), model("b", noisy)), "held-out", ())
    assert comparison.words[0].startswith("a and b cannot be told apart on held-out rows (")
    bare = model("a", good)._replace(blocks=None)
    assert "no blocks to pair" in Comparison((bare, model("b", good)), "test", ()).words[0]


@pytest.fixture(scope="module")
def steep() -> tuple[FitResult, FitResult]:
    """A line, and one whose slope is a tenth too small."""
    train, test = pressed(1.3, 6.0, seed=0)
    return line(train, test), line(train, test, slope=1.17)


def test_fits_of_other_data_or_other_rows_are_refused(steep) -> None:
    free, given = steep
    other = line(*pressed(1.3, 6.0, seed=1))
    refuses("not-comparable", lambda: compare({"one": free, "two": other}), "do not compare")
    renamed = replace(free, train=replace(free.train, output_name="height"))
    with pytest.raises(InputError, match="one predicts displacement, two height"):
        compare({"one": free, "two": renamed})
    refuses("too-few-fits", lambda: compare([free]), "give two or more")
    # Fitted to fewer rows: the test record is still the same.
    fewer = replace(given, train=given.train.select(cycle=[3, 4, 5]))
    found = compare({"one": free, "two": fewer})
    assert found.ranked_on == "test"
    assert found.pairs[0].held_out is None
    assert "other training rows" in found.notes[0]
    with raises("not-comparable", "share no test record"):
        compare({"one": free, "two": replace(fewer, test=None)})


def test_evidence_is_the_integral_of_the_posterior(steep) -> None:
    """A grid over K, b and log sigma; Laplace's error is of the order of 1 / rows."""
    fitted = steep[0]
    about = target(fitted)
    curvature = -np.asarray(jax.jit(jax.hessian(about.log_probability))(about.start))
    root = np.linalg.cholesky(np.linalg.inv(curvature))
    axis = np.linspace(-6, 6, 25)  # half a deviation: of a near Gaussian exact to 1e-8
    grid = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), -1).reshape(-1, 3)
    points = jnp.asarray(np.asarray(about.start) + grid @ root.T)
    heights = np.asarray(jax.jit(jax.vmap(about.log_probability))(points))
    volume = (axis[1] - axis[0]) ** 3 * abs(np.linalg.det(root))
    exact = scipy.special.logsumexp(heights) + np.log(volume)
    (found,) = (
        one for one in compare({"free": fitted, "given": steep[1]}).models if one.name == "free"
    )
    assert found.log_evidence == pytest.approx(exact, abs=0.03)


def test_candidates_and_folders_of_real_fits(tmp_path) -> None:
    train, test = pressed(1.3, 6.0, seed=0)
    options = {"test": test, "starts": 2, "noise": "gaussian", "conditioning": "keep"}
    first = fit(train, "LinearSponge", **options)
    later = fit(train, LinearSponge(K=1.3, b=6.0, threshold=8.0), **options)
    save(first, tmp_path / "at first contact")
    save(later, tmp_path / "from 8 N")
    found = compare([tmp_path / "at first contact", tmp_path / "from 8 N"])
    assert found.best == "at first contact"
    assert [m.numbers for m in found.models] == [2, 2]
    (pair,) = found.pairs
    assert pair.held_out.clear
    assert pair.held_out.blocks == 10
    assert found.models[0].test == pytest.approx(first.metrics["test"].nrmse_percent)  # type: ignore[union-attr]
    # What a folder keeps of its candidates gives the same pair.
    both = replace(first, candidates=(first, replace(later, name="from 8 N")))
    save(both, tmp_path / "both")
    kept = compare_candidates(tmp_path / "both")
    again = kept.pair("LinearSponge", "from 8 N").held_out
    assert again == pytest.approx(pair.held_out)
    assert [m.bic for m in kept.models] == pytest.approx([m.bic for m in found.models])
    assert "figures alone" in kept.notes[0]
    with pytest.raises(InputError, match="one model was tried"):
        compare_candidates(tmp_path / "from 8 N")
