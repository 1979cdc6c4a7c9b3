"""How objects print and draw themselves: short, with numbers and units, in one way only."""

from dataclasses import replace
from functools import cache
from typing import Any

import jax
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


@cache
def record() -> Record:
    t, force, x, _ = SpongeRig().five_cycles(step=2.0, noise=0.02, seed=0)
    return Record.from_arrays(force, x, t, input_unit="N", output_unit="mm",
                              input_name="force (N)", output_name="x (mm)")  # fmt: skip


@cache
def fitted() -> FitResult:
    return fit(record(), model="LinearSponge", test_cycles=1, noise="gaussian", starts=2)


def posterior(count: int = 2) -> Posterior:
    draws = np.random.default_rng(0).normal(size=(4, 100, count))
    names = tuple(f"k{i}" for i in range(count))
    summaries = tuple(summary_of(n, draws[..., k], 400.0) for k, n in enumerate(names))
    return Posterior(names, draws, None, summaries, "emcee", 0.4, 20.0, 1.0, ("A note.",))


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
    assert (
        repr(record()) == f"<Record of {len(record())} rows, 1 sequences: 'force (N)' -> 'x (mm)'>"
    )


def test_a_fit_prints():
    found = fitted()
    text = short(str(replace(found, parameters=40 * found.parameters)))
    assert text.startswith(f"LinearSponge: {found.verdict.level}")
    assert "mm/N" in text or "mm / N" in text
    assert found.verdict.reasons[0] in text
    assert repr(found) == f"<FitResult LinearSponge: {found.verdict.level}, {len(record())} rows>"


def test_a_posterior_prints():
    text = short(str(posterior(60)))
    assert "400 draws by emcee" in text
    assert "R-hat" in text
    assert "A note." in text


def test_plots_are_figures():
    grid = invert(Preisach(GridDensity(0.0, 10.0, np.tri(6))))
    drawn = [record().plot(), fitted().plot(), posterior().plot(), grid.plot()]
    assert all(isinstance(figure, Figure) for figure in drawn)
    for figure in drawn[:2]:
        assert figure.axes[0].get_xlabel() == "force (N)"
        assert figure.axes[0].get_ylabel() == "x (mm)"
    assert len(posterior(3).plot(["k2"]).axes) == 1
    refuses("unknown-parameter", lambda: posterior().plot(["gone"]))


def test_masked_rows_are_drawn_apart():
    figure = record().select(cycle=1).plot()
    assert [line.get_label() for line in figure.axes[0].lines] == ["excluded", "used"]
