"""The examples in docstrings: each is run, and prints what it shows.

**Convention.** Every public function, and every public class with methods of its own
(`docs/tools/public.py` lists what is public), ends its docstring with a part like this one, of about
three lines:

    **Example:**

        >>> record.n_cycles
        5

This is a doctest. The code must print what the lines below it show; `...` matches any text (write
`0.12...` where the last digits depend on the machine), and the amount of white space does not count.
Print plain numbers: `float(x)`, `round(x, 2)`, `f"{x:.2f}"`, `x.shape`. An example takes one second
at most, compilation included, so use the prepared objects; longer studies belong on a page of docs/.
Each example runs in an empty temporary folder, which is also available as `folder`.

**Prepared names** are the functions below that are marked `@prepared`, and the modules in `ALWAYS`.
Each object is made when the first example needs it, and then shared: do not change one in place.
An example may import more. To prepare another object, add such a function.
"""

import ast
import doctest
import inspect
import textwrap
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import compensate
import compensate.armor
import compensate.internal
import compensate.microchannel
import compensate.runtime
import hysid
import hysid.plots
import hysteresis
import hysteresis.curves
import hysteresis.internal
import hysteresis.preisach
import hysteresis.rigs
import identify
from compensate.armor import planned_presses
from identify.internal import Forc
from tests.test_docs import tool

DATASETS = Path(__file__).parents[1] / "datasets"
COLUMNS = ("force (N)", "displacement (mm)", "time (s)")
FLAGS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
PUBLIC: dict[str, Any] = tool("public").public_names()
INTERNAL = {
    f"{package.__name__}.{name}": value
    for package in (hysteresis.internal, compensate.internal, identify.internal)
    for name, value in vars(package).items()
    if getattr(value, "__module__", "").partition(".")[0]
    in ("hysteresis", "identify", "compensate")
}
PREPARED: dict[str, Callable[[], Any]] = {}


def prepared(make: Callable[[], Any]) -> Callable[[], Any]:
    """Enters what is made as an object of examples, under the function's name; it is made once."""
    PREPARED[make.__name__] = cache(make)
    return PREPARED[make.__name__]


@prepared
def record() -> hysteresis.Record:
    """The shipped sponge of 50 mm: five cycles of force (N) and displacement (mm), 101 rows."""
    return hysteresis.read_csv(DATASETS / "sponge-50mm-cycles.csv", *COLUMNS)


@prepared
def loops() -> hysteresis.Record:
    """The same sponge's nested loops: first-order reversal curves are among them."""
    return hysteresis.read_csv(DATASETS / "sponge-50mm-minor-loops.csv", *COLUMNS)


@prepared
def fit() -> identify.FitResult:
    """`LinearSponge`, two free parameters, fitted to four cycles and tested on the fifth."""
    return identify.fit(record(), "LinearSponge", test_cycles=1, noise="gaussian")


@prepared
def grid_fit() -> identify.FitResult:
    """A `Preisach` model with 21 weights between 0 N and 50 N."""
    template = hysteresis.Preisach(hysteresis.preisach.GridDensity(0.0, 50.0, np.tri(6)))
    return identify.fit(record(), template, test_cycles=1, noise="gaussian")


@prepared
def shaken_fit() -> identify.FitResult:
    """An oscillator around Bouc-Wen's force, fitted to two settled periods of a multisine."""
    spring = hysteresis.BoucWenForce(alpha=5e4, beta_gamma=800.0, beta_delta=-300.0)
    plant = hysteresis.Oscillator(mass=2.0, damping=20.0, stiffness=5e4, hysteresis=spring)
    force = np.tile(identify.multisine(5.0, 70.0, 40.0, rows=512, dt=2e-3), 3)
    t = 2e-3 * np.arange(len(force))
    noise = 1e-5 * np.random.default_rng(0).normal(size=len(t))
    shaken = hysteresis.Record.from_arrays(
        force, plant.displacement(t, force) + noise, t, input_unit="N", output_unit="m"
    )
    return identify.fit(shaken, "Oscillator(BoucWen)")


@prepared
def posterior() -> identify.internal.Posterior:
    """A short run of the sampler on `fit`."""
    return identify.sample(fit(), steps=100, seed=0)


@prepared
def specimens() -> list[identify.FitResult]:
    """`LinearSponge` fitted to three sponges: as `record`, and softer by 20 % and by 40 %."""
    softer = [replace(record(), output=factor * record().output) for factor in (1.0, 1.2, 1.4)]
    return [identify.fit(one, "LinearSponge", noise="gaussian", starts=2) for one in softer]


@prepared
def curves() -> tuple[Forc, ...]:
    """First-order reversal curves of `loops`, those from 0, 4, 8, 12 and 16 N."""
    return identify.forc_curves(loops())[2:]


@prepared
def model() -> hysteresis.AbstractModel:
    """A Prandtl-Ishlinskii model with two plays: fast, rising, invertible."""
    return hysteresis.PrandtlIshlinskii(np.array([0.5, 1.5]), np.array([0.4, 0.2]), 1.0)


@prepared
def preisach() -> hysteresis.Preisach:
    """A Preisach model with 21 equal weights between 0 and 10."""
    return hysteresis.Preisach(hysteresis.preisach.GridDensity(0.0, 10.0, np.tri(6)))


@prepared
def t() -> np.ndarray:
    """Times of `u`: (13,), one second apart."""
    return np.arange(13.0)


@prepared
def u() -> np.ndarray:
    """An input history with an inner loop: up to 6, down to 2, up to 4, down to 0, in steps of 1."""
    return np.array([0.0, 1, 2, 3, 4, 5, 6, 5, 4, 3, 2, 4, 0])


@prepared
def compensator() -> compensate.AbstractCompensator:
    """The inverse of `model`."""
    return compensate.invert(model())


@prepared
def box() -> compensate.armor.Box:
    """A box-shaped shell of 0.3 m x 0.3 m x 0.55 m."""
    return compensate.armor.Box(dx=0.3, dy=0.3, dz1=0.55, dz2=0.0)


@prepared
def solver() -> compensate.armor.ContactSolver:
    """Contacts on `box` under the paper's sponge."""
    sponge = hysteresis.LinearSponge(K=1.298, b=6.186, threshold=1.5)
    return compensate.armor.ContactSolver(box(), compensator=sponge)


@prepared
def armor() -> compensate.armor.Armor:
    """A perfect wrist sensor below `solver`."""
    return compensate.armor.Armor(compensate.armor.WristSensor(), solver())


@prepared
def presses() -> Any:
    """Twenty presses of a finger at each of the five places of a virtual microchannel sensor."""
    return hysteresis.rigs.MicrochannelRig(seed=11).finger_presses(20)


@prepared
def planned() -> compensate.armor.Presses:
    """Presses of 5, 10 and 15 N at the middle of each of the five sides of `box`, as `armor` reads them."""
    inward = np.array([[0, 0, -1], [0, -1, 0], [0, 1, 0], [-1, 0, 0], [1, 0, 0]], float)
    force = np.tile([5.0, 10.0, 15.0], (5, 1))
    return planned_presses(armor(), np.arange(3.0), force, inward, box().centres(), np.arange(1, 6))


@prepared
def channels() -> compensate.internal.ChannelSensor:
    """Two layers under two contacts that both follow `model`."""
    return compensate.internal.ChannelSensor([model(), model()], [[1.0, 0.5], [0.5, 1.0]])


@prepared
def estimator() -> compensate.internal.ForceEstimator:
    """Force from a reading of `model`, up to 6 N, by its inverse."""
    backwards = compensate.internal.BackwardsModel(compensator())
    return compensate.internal.ForceEstimator(backwards, 0.05, 6.0)


def alone(place: str) -> list[hysid.ForceRecord]:
    """Six sequences of the shipped skin that press one of its two places."""
    table = hysteresis.read_table(DATASETS / "skin-two-places.csv")
    session, time = table.number("session"), table.number("time (s)")
    reading = np.column_stack([table.number(f"layer {k} (V)") for k in (1, 2)])
    force = table.number(f"force {place} (N)")
    rows = [session == k for k in np.unique(session[(force > 0) & (session < 13)])]
    return [hysid.ForceRecord(time[at], reading[at], force[at]) for at in rows]


@prepared
def presses_of_b() -> list[hysid.ForceRecord]:
    """Sequences of the shipped skin that press its place B alone."""
    return alone("B")


@prepared
def presses_of_d() -> list[hysid.ForceRecord]:
    """Sequences of the shipped skin that press its place D alone."""
    return alone("D")


@prepared
def learnt() -> Any:
    """The two places of the shipped skin, after a training of a moment."""
    return hysid.train_contacts({"B": presses_of_b(), "D": presses_of_d()}, updates=20)


@prepared
def contacts_file() -> Path:
    """`learnt` as a file that runs without JAX."""
    volts = [compensate.Quantity(f"layer {k}", "V") for k in (1, 2)]
    newtons = [compensate.Quantity(name, "N") for name in "BD"]
    record = presses_of_b()[0]
    return compensate.microchannel.export_contacts(
        learnt().estimator, Path(mkdtemp()) / "contacts.json", record.reading, record.time,
        channels=volts, contacts=newtons,
    )  # fmt: skip


ALWAYS = {
    "np": np, "jnp": jnp, "jax": jax, "eqx": eqx, "hysid": hysid, "hysteresis": hysteresis,
    "identify": identify, "compensate": compensate, "datasets": DATASETS,
}  # fmt: skip


def behaves(value: Any) -> bool:
    """Whether it is a function, or a class that can be made and does something."""
    if not inspect.isclass(value):
        return True
    own = (v for k, v in vars(value).items() if not k.startswith("_") or k == "__call__")
    does = any(inspect.isfunction(v) or isinstance(v, classmethod | staticmethod) for v in own)
    return does and not value.__name__.startswith("Abstract")


def examples(value: Any) -> Iterator[tuple[str, str]]:
    """(name, docstring) of a public object and of its own members, where there is an example."""
    members = vars(value).items() if inspect.isclass(value) else ()
    for name, each in [("", value), *((k, v) for k, v in members if not k.startswith("_"))]:
        text = inspect.getdoc(each) or ""
        if ">>>" in text and (name == "" or text != inspect.getdoc(type(each))):
            yield name, text


WITH = {
    f"{name}.{member}".rstrip("."): text
    for name, value in (INTERNAL | PUBLIC).items()
    for member, text in examples(value)
}


def names_in(code: str) -> set[str]:
    return {node.id for node in ast.walk(ast.parse(code)) if isinstance(node, ast.Name)}


def run_example(name: str, text: str, folder: Path) -> str:
    """What differs between what the example shows and what it gives."""
    parsed = doctest.DocTestParser().get_doctest(text, {}, name, None, None)
    wanted = set[str]().union(*(names_in(each.source) for each in parsed.examples))
    parsed.globs = {**ALWAYS, "folder": folder}
    parsed.globs |= {key: PREPARED[key]() for key in wanted & PREPARED.keys()}
    said: list[str] = []
    doctest.DocTestRunner(optionflags=FLAGS).run(parsed, out=said.append)
    return "".join(said)


@pytest.mark.pages
@pytest.mark.parametrize("name", WITH)
def test_an_example_gives_what_it_shows(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    heading, marker, body = WITH[name].partition("**Example:**\n\n")
    assert marker, "its example stands below **Example:**"
    assert ">>>" not in heading
    assert body == textwrap.indent(textwrap.dedent(body), "    "), "the example ends the docstring"
    monkeypatch.chdir(tmp_path)
    assert run_example(name, textwrap.dedent(body), tmp_path) == ""


def test_everything_public_that_does_something_has_an_example():
    needed = {name for name, value in PUBLIC.items() if behaves(value)}
    shown = WITH.keys() | {name.rpartition(".")[0] for name in WITH}  # a class by its methods
    assert sorted(needed - shown) == [], "write an example"


def test_an_example_that_gives_something_else_is_found(tmp_path: Path):
    assert run_example("x", ">>> record.n_cycles\n5\n>>> u.max()\nnp.float64(6.0)", tmp_path) == ""
    assert "Got:\n    5" in run_example("x", ">>> record.n_cycles\n6", tmp_path)
    assert "NameError" in run_example("x", ">>> unheard_of", tmp_path)
