"""What a notebook is shown: whole HTML, nobody's markup, the names, units and verdicts that matter."""

import base64
from dataclasses import replace
from functools import cache
from xml.etree import ElementTree

import jax
import jax.numpy as jnp
import matplotlib
import numpy as np
import pytest

from compensate import invert
from hysteresis import Burgers, Preisach, Record
from hysteresis.preisach import GridDensity
from hysteresis.rigs import SpongeRig
from identify import FitResult, fit
from identify.internal import Posterior
from identify.posterior._posterior import summary_of

NASTY = 'force <script>alert("&")</script> (N)'
MOST = 200_000


@cache
def record() -> Record:
    t, force, x, cycle = SpongeRig().five_cycles(step=2.0, noise=0.02, seed=0)
    rows = cycle <= 3
    return Record.from_arrays(
        force[rows], x[rows], t[rows], input_name=NASTY, input_unit="N",
        output_name="displacement (mm)", output_unit="mm", source="run <1>.csv",
    )  # fmt: skip


@cache
def fitted() -> FitResult:
    return fit(record(), model="LinearSponge", test_cycles=1, noise="gaussian", starts=2)


def drawn(converged: bool = True) -> Posterior:
    draws = np.random.default_rng(0).normal(size=(4, 500, 2)) * [1, 3] + [0, 20 * (not converged)]
    if not converged:
        draws[0] += 10
    names = ("E<1>", "eta1")
    summaries = [summary_of(n, draws[..., k], 400.0) for k, n in enumerate(names)]
    return Posterior(names, draws, None, tuple(summaries), "emcee", 0.4, 20.0, 1.0, ("mind & me",))


def grid() -> Preisach:
    return Preisach(GridDensity(0.0, 10.0, np.tri(6)))


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


def test_record_that_cannot_be_used():
    same = Record.from_arrays(np.ones(30), np.arange(30.0))
    assert "constant-input" in read(same._repr_html_())[1]


def test_fit():
    found = fitted()
    words = read(found._repr_html_())[1]
    assert str(found) in words
    assert found.verdict.level in words


@pytest.mark.parametrize("converged", [True, False])
def test_posterior(converged: bool):
    posterior = drawn(converged)
    assert posterior.converged is converged
    words = read(posterior._repr_html_())[1]
    assert ("not converged" in words) is not converged
    for said in ("E<1>", "eta1", "mind & me", "2000 draws by emcee"):
        assert said in words


def test_compensator_of_many_draws():
    draws = [Burgers(E1=E1, eta1=2.0, E2=3.0, eta2=4.0) for E1 in (1.0, 1.1, 1.2)]
    many = jax.tree.map(lambda *leaves: jnp.stack(leaves), *draws)
    words = read(invert(many)._repr_html_())[1]
    assert "EnsembleCompensator" in words
    assert "[1, 1.1, 1.2]" in words


def test_long_records_and_many_parameters_stay_small():
    u = 20 * np.abs(np.sin(np.arange(20_000) / 300))
    read(Record.from_arrays(u, u + np.sin(u), dt=0.01)._repr_html_())
    many = replace(fitted(), parameters=40 * fitted().parameters)
    assert "more" in read(many._repr_html_())[1]


def test_nothing_global_is_touched():
    before = dict(matplotlib.rcParams)
    with matplotlib.rc_context({"axes.facecolor": "red", "text.usetex": True}):
        user = dict(matplotlib.rcParams)
        first = record()._repr_html_()
        assert dict(matplotlib.rcParams) == user
    assert dict(matplotlib.rcParams) == before
    assert record()._repr_html_() == first


@pytest.mark.parametrize(
    "make",
    [record, fitted, drawn, lambda: invert(grid())],
    ids=["record", "fit", "draws", "inverse"],
)
def test_notebooks_find_it(make):
    thing = make()
    assert read(thing._repr_html_())
