"""What docs, cards and the reproduction of two papers say of the virtual rigs, computed again.

Each claim is a function that gives 1 where it is true. A claim of which text is a part is true where the
text says it and the numbers do.
"""

import tempfile
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from compensate.armor import Box, ContactSolver
from hysid.armor._touches import VIRTUAL, replay, save_touches, shell_of
from hysid.reproduction._armor import STRONGLY, nonlinearity
from hysid.reproduction._skin_paper import PAPER
from hysteresis import BoucWen, LinearSponge, PrandtlIshlinskii
from hysteresis.internal import FoamBlock, ForceSensor, GaugeSensor, force_path
from hysteresis.rigs import ArmorRig
from hysteresis.rigs._foam_block import _State
from hysteresis.rigs._force_sensors import _SLIPS

from .. import datasets
from .._measure import Row, judged, noted

ROW = "reproduction, cards, docs: claims of D"
ROOT = Path(__file__).resolve().parents[2]
ROUNDING = 1e-13
"""Of quantities of order one after a hundred steps."""

FALSE = (
    "no elements of the package", "no model of ours contains", "physics is in no model", "hardly feel it",
    "friction, flow and air", "finite-difference foam", "Every parameter has a 90 % interval",
    "physics that our models do not contain", "physics no model contains",
)  # fmt: skip
"""What was said once and is not so."""

LAYERS = {50.0: (0.08, 0.60), 10.0: (0.04, 0.19)}
"""Of `FoamBlock`'s docstring: thickness in mm -> height left of the first and the last layer at 20 N."""


def _text(name: str) -> str:
    return " ".join((ROOT / name).read_text(encoding="utf-8").split())


def _strains(seed: int = 0) -> np.ndarray:
    turns = np.random.default_rng(seed).uniform(0, 0.9, 12)
    return np.concatenate([np.linspace(a, b, 20) for a, b in pairwise(turns)])


def _slip(x: np.ndarray, length: float) -> np.ndarray:
    """Friction by our model, over its largest value."""
    model = BoucWen(k=1 / length, alpha=0.0, yield_at=length)
    return np.asarray(model.simulate(None, np.append(0.0, x)))[1:]


def foam_friction() -> bool:
    """The friction of `FoamBlock` is `BoucWen` with n = 1 and gamma = 0, as its page says."""
    block, path = FoamBlock(layers=1), _strains()
    kinds, times = len(block.slip_strain), len(block.flow_s)
    zero = np.zeros((1, 1))
    state = _State(zero, zero, np.zeros((kinds, 1, 1)), np.zeros((times, 1, 1)))
    rubs = []
    for e in path:
        state = block._struts(state, np.full((1, 1), e), np.ones((1, 1)), 1.0)[2]
        rubs.append(state.rub[:, 0, 0])
    ours = np.stack([_slip(path, length) for length in block.slip_strain], 1)
    said = "friction of `FoamBlock` and `GaugeSensor` is `BoucWen`" in _text("docs/api/rigs.md")
    return said and float(np.abs(np.array(rubs) - ours).max()) < ROUNDING


def gauge_friction() -> bool:
    """That of `GaugeSensor` likewise."""
    sensor = GaugeSensor(noise_n=1e-30, noise_nm=1e-30)
    path = _strains(1)[None, :, None] * np.ones((1, 1, 6))
    strain = np.tile(np.eye(6), (2, 1))[:8]
    with_friction = sensor._bridges(path, strain, np.zeros((8, 2)))[0, :, 0]
    ours = np.mean([_slip(path[0, :, 0], length) for length in _SLIPS], axis=0)
    expected = path[0, :, 0] - sensor.hysteresis / 2 * ours
    return float(np.abs(with_friction - expected).max()) < ROUNDING


def force_sensor() -> bool:
    """`ForceSensor` is `PrandtlIshlinskii`, and the docs say so."""
    sensor = ForceSensor(crosstalk=0.0, noise_n=0.0, noise_nm=0.0)
    load = 40 * _strains(2)
    wrench = np.zeros((1, len(load), 6))
    wrench[0, :, 2] = load
    read = sensor.read(wrench, np.eye(6), np.random.default_rng(0))[0, :, 2]
    # w - c s is a play of the stop's travel beside a share of the load that passes as it is.
    travel = sensor.travel * sensor.full_scale_n
    share = sensor.hysteresis * sensor.full_scale_n / (2 * travel)
    play = PrandtlIshlinskii(np.array([travel]), np.array([share]), 1 - share)
    ours = np.asarray(play.simulate(None, np.append(0.0, load)))[1:]
    said = "plays of `ForceSensor` are those of `PrandtlIshlinskii`" in _text("docs/api/rigs.md")
    return said and float(np.abs(read - ours).max()) < 40 * ROUNDING


def default_sensor() -> bool:
    """The armor is read by the sensor that is no model of ours, and so is the page about touches."""
    page = _text("docs/touch-anywhere.md")
    return isinstance(ArmorRig().sensor, GaugeSensor) and "ForceSensor" not in page


def thin_foam() -> bool:
    """Fig 10, without noise: a block of 10 mm is much less linear than those of 30 and 50 mm."""
    bent = {h: nonlinearity(_block(h).five_cycles()) for h in (50.0, 30.0, 10.0)}
    return bent[10.0] > STRONGLY * max(bent[50.0], bent[30.0])


def layers() -> bool:
    """The docstring's heights of the highest and the lowest layer at 20 N."""
    for thickness, (high, low) in LAYERS.items():
        block, at = _block(thickness), force_path((0.0, 20.0), 2.0)
        whole = block.follow(at)[-1]
        one = replace(block, layers=block.layers)
        left = 1 - _last_strains(one, at)
        if abs(left.mean() - (1 - whole / thickness)) > 1e-9:
            return False
        if abs(left[0] - high) > 0.01 or abs(left[-1] - low) > 0.01:
            return False
    said = FoamBlock.__doc__ or ""
    return "squashed to 8 %" in said and "60 %" in said and "below 19 %" in said


def _block(thickness: float) -> FoamBlock:
    return FoamBlock(thickness_mm=thickness)


def _last_strains(block: FoamBlock, force: np.ndarray) -> np.ndarray:
    seen: list[np.ndarray] = []
    plain = FoamBlock._yield

    def watched(self: FoamBlock, *given: Any) -> Any:
        state = plain(self, *given)
        seen.append(state.strain[0])
        return state

    FoamBlock._yield = watched  # type: ignore[method-assign]
    try:
        block.follow(force)
    finally:
        FoamBlock._yield = plain  # type: ignore[method-assign]
    return seen[-1]


def air() -> bool:
    """The docstring's 0.002 mm that air moves the block by, at the paper's rates."""
    free = replace(FoamBlock(), permeability_mm2=1.0).five_cycles().displacement
    moved = np.abs(free - FoamBlock().five_cycles().displacement).max()
    return "0.002 mm" in (FoamBlock.__doc__ or "") and abs(moved - 0.002) < 0.0005


def no_false_phrase() -> bool:
    """None of the sentences that were false stands in code, docs, cards or the changelog."""
    places = [ROOT / "CHANGELOG.md", ROOT / "README.md"]
    for folder in ("docs", "datasets", "hysteresis", "identify", "compensate", "hysid", "tests"):
        places += [
            f for f in (ROOT / folder).rglob("*") if f.suffix in (".md", ".py", ".j2", ".toml")
        ]
    texts = (" ".join(place.read_text(encoding="utf-8").split()) for place in places)
    return not any(phrase in text for text in texts for phrase in FALSE)


def time_is_no_prediction() -> bool:
    """A training time on another computer is not called predicted."""
    return all(row.label != "predicted" for row in PAPER.published if not row.judged)


def epochs_are_told() -> bool:
    """`kim2018` says how long the networks of one contact, the paper's of two and ours of two train."""
    return PAPER.said["trained"].count("{") == 3


def armor_page_is_virtual() -> bool:
    """The page of touches that nobody measured says so."""
    presses = ArmorRig().press([[0.0, 0.0, 0.55]], [1])
    solver = ContactSolver(Box(0.3, 0.3, 0.55, 0.0), LinearSponge(K=1.298, b=6.186, threshold=1.5))
    force, moment = np.split(presses.wrench[0], 2, axis=1)
    with tempfile.TemporaryDirectory() as out:
        found = solver.solve(force, moment)
        title = f"One press{VIRTUAL}"
        save_touches(
            Path(out), shell_of(solver.shape), presses.time, force, moment, found, title=title
        )
        page = Path(replay(Path(out))["file"]).read_text(encoding="utf-8")
    source = (ROOT / "hysid/commands/_armor.py").read_text(encoding="utf-8")
    return "virtual" in page.partition("</h1>")[0] and "VIRTUAL" in source


def data_are_as_the_cards_say() -> bool:
    """`python -m benchmarks.datasets --check`."""
    return datasets.main(["--check"]) == 0


def the_default_road() -> bool:
    """README and report say which solver made the winner, and which numbers emcee samples."""
    said = _text("README.md")
    return "non-negative least squares" in said and "emcee" in said


CLAIMS: tuple[Callable[[], bool], ...] = (
    foam_friction, gauge_friction, force_sensor, default_sensor, thin_foam, layers, air, no_false_phrase,
    time_is_no_prediction, epochs_are_told, armor_page_is_virtual,
    data_are_as_the_cards_say, the_default_road,
)  # fmt: skip

SLOW = (data_are_as_the_cards_say,)
"""Left out of `--quick`."""


def rows(quick: bool) -> list[Row]:
    """Each claim with a 1 where it is true, and how many are not."""
    claims = [claim for claim in CLAIMS if not (quick and claim in SLOW)]
    true = {claim: bool(claim()) for claim in claims}
    found = [
        judged(f"{ROW}: not true, of {len(true)}", float(sum(not x for x in true.values())), 0.0)
    ]
    for claim, is_true in true.items():
        about = (claim.__doc__ or "").split("\n")[0]
        found.append(judged(f"  {about}", float(is_true), 1.0, at_least=True))
    bent = {h: nonlinearity(_block(h).five_cycles()) for h in (50.0, 30.0, 10.0)}
    for h, x in bent.items():
        found.append(noted(f"  noise-free nonlinearity of the foam, {h:g} mm, % of its range", x))
    return found
