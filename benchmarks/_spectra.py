"""Spectra of every clock on public data and known cases: errors, shift factors, cards, lmfit beside us.

The master curves are NREL's (pyvisco), the creep curves those of polystyrene, polyethylene and a foam.
lmfit fits the same rows and numbers of parameters from many starts, with positive strengths.
"""

import time
from pathlib import Path

import lmfit
import numpy as np

from compensate import material_card
from compensate.export._cards import PROGRAMS
from hysteresis import GeneralizedMaxwell, Record
from identify import Response, fit_step, master_curve, spectrum

from ._accuracy.creep import RECORDS, even_in_log_time
from ._measure import Row, judged, noted
from .accuracy import data_folder

NREL, CASES = "relaxation-master", "cases"
TERMS = (1, 2, 3, 4)
NEARLY = 1.03
"""Above lmfit's best error by no more than this."""


def rows(quick: bool = False) -> list[Row]:
    """All figures; `quick` has fewer starts of lmfit."""
    found = [*_cards()]
    for what, made in (
        ("public master curves", _public),
        (
            "creep and relaxation beside lmfit",
            lambda folder: _beside_lmfit(folder, 3 if quick else 12),
        ),
        ("ramp then hold", _ramp),
    ):
        try:
            found += made(data_folder())
        except OSError:
            found.append(noted(what, float("nan"), reason="the data are not here"))
    return found


def _public(folder: Path) -> list[Row]:
    t, y = _table(folder / NREL / "time_user_master.csv").T
    response = Response(t, y, "relaxation")
    found, seconds = spectrum(response), np.inf
    for _ in range(3):
        begin = time.process_time()
        spectrum(response)
        seconds = min(seconds, time.process_time() - begin)
    f, storage, loss = _table(folder / NREL / "freq_user_master.csv").T
    alone = spectrum(Response(2 * np.pi * f, storage, "modulus"))
    both = spectrum(Response(2 * np.pi * f, storage + 1j * loss, "modulus"))
    told = any("contradict" in note for note in both.notes)
    return [
        judged("master curve over time, rms of the reading, %", 100 * found.row.rms, 0.12),
        judged("the same, seconds of the processor", seconds, 1.0),
        noted("the same, terms", found.order),
        judged("the same with 8 terms, rms, % (greedy search: 3.7)", _short(response, 8), 3.7),
        judged(
            "storage moduli over frequency, rms, % (freest spectrum: 1.39)",
            100 * alone.row.rms,
            0.5,
        ),
        judged("storage and loss moduli together, rms, %", 100 * both.row.rms, 0.5),
        judged("it says that these contradict each other", float(told), 1.0, at_least=True),
        *_raw(folder),
    ]


def _short(response: Response, terms: int) -> float:
    return 100 * spectrum(response, terms=terms).row.rms


def _raw(folder: Path) -> list[Row]:
    """Raw rows at 21 temperatures to master curves."""
    found = []
    for name, what, reference in (
        ("time_user_raw", "raw rows over time", 3.0),
        ("freq_user_raw", "raw storage and loss moduli", -5.0),
    ):
        table = _table(folder / NREL / f"{name}.csv")
        sets = [table[table[:, -1] == k] for k in np.unique(table[:, -1])]
        sets = [one[np.argsort(one[:, 0])] for one in sets]
        if name.startswith("time"):
            parts = [Response(one[:, 0], one[:, 1], "relaxation") for one in sets]
            published = _table(folder / NREL / "time_user_raw__shift_factors.csv")[::-1]
        else:
            parts = [
                Response(2 * np.pi * one[:, 0], one[:, 1] + 1j * one[:, 2], "modulus")
                for one in sets
            ]
            published = _table(folder / NREL / "freq_user_master__shift_factors.csv")[::-1]
        begin = time.perf_counter()
        curve = master_curve(parts, [float(one[:, -2].mean()) for one in sets], reference)
        seconds = time.perf_counter() - begin
        apart = np.abs(curve.shifts.log_a - published[:, 1])
        worst = float(np.max(apart / np.maximum(curve.shifts.error, 1e-3)))
        found += [
            judged(
                f"{what} to a master curve, rms of the reading, %",
                100 * curve.spectrum.row.rms,
                1.0,
            ),
            noted("the same, seconds", seconds),
            judged("published shift factors, largest distance in our standard errors", worst, 2.0),
        ]
    return found


def _beside_lmfit(folder: Path, starts: int) -> list[Row]:
    found = []
    for record in RECORDS:
        t, y = record.read(folder)
        t, y = even_in_log_time(t[t >= record.begin], y[t >= record.begin])
        for terms in TERMS:
            ours = spectrum(Response(t, y, record.kind), terms=terms)
            theirs = _lmfit(t, y, record.kind, terms, starts)
            what = f"{record.what}, {record.kind}, {terms} terms: rms over lmfit's best"
            found.append(judged(what, ours.row.rms / theirs, NEARLY))
    return found


def _lmfit(t: np.ndarray, y: np.ndarray, kind: str, terms: int, starts: int) -> float:
    """The best relative error of so many terms, from starts all over the record's times."""
    rng, best = np.random.default_rng(0), np.inf

    def curve(p: lmfit.Parameters) -> np.ndarray:
        v = p.valuesdict()
        decays = [np.exp(-t * np.exp(-v[f"x{k}"])) for k in range(terms)]
        parts = [
            np.exp(v[f"c{k}"]) * (1 - e if kind == "creep" else e) for k, e in enumerate(decays)
        ]
        flow = np.exp(v["flow"]) * t if kind == "creep" else 0.0
        return np.exp(v["spring"]) + flow + np.sum(parts, axis=0)

    for _ in range(starts):
        p = lmfit.Parameters()
        p.add("spring", np.log(y.min()))
        if kind == "creep":
            p.add("flow", np.log(y[-1] / t[-1]) - 1)
        for k in range(terms):
            p.add(f"c{k}", np.log(np.ptp(y) / terms))
            p.add(f"x{k}", rng.uniform(np.log(t[0]), np.log(t[-1])))
        try:
            made = lmfit.minimize(lambda p: curve(p) / y - 1, p, max_nfev=4000)
        except ValueError:  # lmfit met a number that is not finite
            continue
        best = min(best, float(np.sqrt(np.mean(made.residual**2))))
    return best


def _ramp(folder: Path) -> list[Row]:
    t, u, y = np.loadtxt(
        folder.parent / CASES / "04a-ramp-relaxation.csv", delimiter=",", skiprows=1
    ).T
    level = float(np.median(u[-20:]))
    u = np.where(np.abs(u - level) < 1e-3 * level, level, u)
    fit = fit_step(Record.from_arrays(u, y, t))
    told = {p.name: p.value for p in fit.parameters}
    wanted = {"E1": 2.0, "E2": 1.5, "E3": 1.0, "tau1": 0.5, "tau2": 5.0, "tau3": 50.0, "E_inf": 1.0}
    worst = max(abs(told[name] / value - 1) for name, value in wanted.items())
    return [judged("ramp then hold, largest error of a parameter, %", 100 * worst, 2.0)]


def _cards() -> list[Row]:
    """How exactly the numbers in a card are those of the model; tests recompute the curves."""
    model = GeneralizedMaxwell(3.0, [2.0, 40.0, 500.0], [1e3, 0.7, 1e-3])
    there = [program for program in PROGRAMS if material_card(program, model).text]
    return [judged("programs that a card is written for", len(there), 8, at_least=True)]


def _table(file: Path) -> np.ndarray:
    return np.loadtxt(file, delimiter=",", skiprows=2, encoding="utf-8-sig")
