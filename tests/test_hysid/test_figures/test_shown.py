"""How objects print and draw themselves, in notebooks too: short, with names, units, nobody's markup."""

import base64
from dataclasses import replace
from functools import cache
from typing import Any
from xml.etree import ElementTree

import jax
import jax.numpy as jnp
import matplotlib
import numpy as np
import pytest
from matplotlib.figure import Figure

from compensate import invert
from compensate.internal import BracketedCompensator
from hysteresis import Burgers, Note, PrandtlIshlinskii, Preisach, Record, Series, Sum
from hysteresis.curves import PolynomialCurve
from hysteresis.preisach import GridDensity
from hysteresis.rigs import SpongeRig
from identify import FitResult, fit
from identify.internal import Posterior
from identify.posterior._posterior import summary_of
from tests.refusals import refuses

MODELS = {
    "burgers": Burgers(E1=1.25, eta1=20.0, E2=3.0, eta2=4.0),
    "grid": Preisach(GridDensity(0.0, 10.0, np.tri(40))),
    "series": Series([PolynomialCurve([1.0], 0.0, 1.0), PrandtlIshlinskii([0.5, 1.0], [0.4, 0.2], 1.0)]),
    "sum of many": Sum([Burgers(E1=1.0, eta1=2.0, E2=3.0, eta2=4.0)] * 12),
}  # fmt: skip

NASTY = 'force <script>alert("&")</script> (N)'
MOST = 200_000


@cache
def record(name: str = "force (N)") -> Record:
    t, force, x, _ = SpongeRig().five_cycles(step=2.0, noise=0.02, seed=0)
    return Record.from_arrays(force, x, t, input_unit="N", output_unit="mm",
                              input_name=name, output_name="x (mm)", source="run <1>.csv")  # fmt: skip


@cache
def fitted(name: str = "force (N)") -> FitResult:
    return fit(record(name), model="LinearSponge", test_cycles=1, noise="gaussian", starts=2)


def posterior(count: int = 2, apart: float = 0.0) -> Posterior:
    """Of four ensembles, the first of which may lie apart."""
    draws = np.random.default_rng(0).normal(size=(4, 500, count))
    draws[0] += apart
    names = tuple(f"k<{i}>" for i in range(count))
    summaries = tuple(summary_of(n, draws[..., k], 400.0) for k, n in enumerate(names))
    return Posterior(names, draws, None, summaries, "emcee", 0.4, 20.0, 1.0, ("mind & me",))


def short(text: str) -> str:
    assert len(text.split("\n")) <= 30
    assert "f64[" not in text
    return text


def test_a_model_prints_values_units_and_meanings():
    line = next(x for x in str(MODELS["burgers"]).split("\n") if x.startswith("  E1"))
    assert "1.25" in line
    assert "force / displacement" in line
    said = "Burgers(E1=1.25, eta1=20, E2=3, eta2=4, offset=0, leading=False, hold='linear')"
    assert repr(MODELS["burgers"]) == said


def test_a_model_prints_while_it_is_traced():
    said = []

    @jax.jit
    def show(model: Any) -> Any:
        said.append(f"{model!r}{model}")
        return model

    show(MODELS["burgers"])
    assert "traced" in said[0]


@pytest.mark.parametrize("name", MODELS)
def test_compensators_print_their_numbers(name: str):
    searched = name in ("series", "sum of many")
    model = MODELS[name]
    compensator = BracketedCompensator(model, 0.0, 1.0) if searched else invert(model)
    assert type(compensator).__name__ in short(str(compensator))
    assert "f64[" not in repr(compensator)
    assert "\n" not in repr(compensator)


def test_a_record_prints():
    text = short(str(replace(record(), history=(Note("remark", "Done."),) * 60)))
    assert "force (N)" in text
    words = f"{len(record())} rows, 1 sequences: 'force (N)' -> 'x (mm)'"
    assert repr(record()) == f"<Record of {words}>"


def test_a_fit_prints():
    found = fitted()
    text = short(str(replace(found, parameters=40 * found.parameters)))
    assert text.startswith(f"LinearSponge: {found.verdict.level}")
    assert "mm/N" in text or "mm / N" in text
    assert found.verdict.reasons[0] in text
    assert repr(found) == f"<FitResult LinearSponge: {found.verdict.level}, {len(record())} rows>"


def test_a_posterior_prints():
    text = short(str(posterior(60)))
    assert "2000 draws by emcee" in text
    assert "R-hat" in text
    assert "mind & me" in text


def test_plots_are_figures():
    grid = invert(Preisach(GridDensity(0.0, 10.0, np.tri(6))))
    drawn = [record().plot(), fitted().plot(), posterior().plot(), grid.plot()]
    assert all(isinstance(figure, Figure) for figure in drawn)
    for figure in drawn[:2]:
        assert (figure.axes[0].get_xlabel(), figure.axes[0].get_ylabel()) == ("force (N)", "x (mm)")
    assert len(posterior(3).plot(["k<2>"]).axes) == 1
    refuses("unknown-parameter", lambda: posterior().plot(["gone"]))


def test_masked_rows_are_drawn_apart():
    figure = record().select(cycle=1).plot()
    assert [line.get_label() for line in figure.axes[0].lines] == ["excluded", "used"]


def read(page: str) -> tuple[ElementTree.Element, str]:
    """A fragment as a tree, and the words on it."""
    assert len(page) < MOST
    tree = ElementTree.fromstring(page)  # which no open tag, bare < or & gets through
    assert tree.tag == "div"
    assert tree.find(".//script") is None
    for image in tree.iter("img"):
        assert image.get("alt")
        kind, _, packed = image.get("src", "").partition(";base64,")
        assert kind == "data:image/png"
        assert base64.b64decode(packed).startswith(b"\x89PNG")
    return tree, " ".join(tree.itertext())


def test_a_page_of_a_record_that_cannot_be_used():
    same = Record.from_arrays(np.ones(30), np.arange(30.0))
    assert "constant-input" in read(same._repr_html_())[1]


def test_a_page_of_a_fit():
    found = fitted(NASTY)
    words = read(found._repr_html_())[1]
    assert str(found) in words
    assert found.verdict.level in words


@pytest.mark.parametrize("converged", [True, False])
def test_a_page_of_a_posterior(converged: bool):
    drawn = posterior(apart=0.0 if converged else 10.0)
    assert drawn.converged is converged
    words = read(drawn._repr_html_())[1]
    assert ("not converged" in words) is not converged
    for said in ("k<0>", "k<1>", "mind & me", "2000 draws by emcee"):
        assert said in words


def test_pages_of_compensators():
    draws = [Burgers(E1=E1, eta1=2.0, E2=3.0, eta2=4.0) for E1 in (1.0, 1.1, 1.2)]
    many = jax.tree.map(lambda *leaves: jnp.stack(leaves), *draws)
    words = read(invert(many)._repr_html_())[1]
    assert "EnsembleCompensator" in words
    assert "[1, 1.1, 1.2]" in words
    assert read(invert(MODELS["grid"])._repr_html_())


def test_long_records_and_many_parameters_stay_small():
    u = 20 * np.abs(np.sin(np.arange(20_000) / 300))
    read(Record.from_arrays(u, u + np.sin(u), dt=0.01)._repr_html_())
    many = replace(fitted(), parameters=40 * fitted().parameters)
    assert "more" in read(many._repr_html_())[1]


def test_nothing_global_is_touched():
    before = dict(matplotlib.rcParams)
    with matplotlib.rc_context({"axes.facecolor": "red", "text.usetex": True}):
        user, first = dict(matplotlib.rcParams), record(NASTY)._repr_html_()
        assert dict(matplotlib.rcParams) == user
    assert dict(matplotlib.rcParams) == before
    assert record(NASTY)._repr_html_() == first
    assert read(first)
