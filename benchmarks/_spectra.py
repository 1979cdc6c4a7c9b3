"""Spectra of every clock on public data and known cases: errors, shift factors, cards, lmfit beside us.

The master curves are NREL's (pyvisco), the creep curves those of polystyrene, polyethylene and a foam.
lmfit fits the same rows and numbers of parameters from many starts, with positive strengths.
"""

import time
from pathlib import Path

import lmfit
import numpy as np
import scipy

from compensate import material_card
from compensate.export._cards import PROGRAMS
from hysteresis import GeneralizedMaxwell, Record
from identify import Response, fit_step, master_curve, spectrum

from ._accuracy.creep import RECORDS, even_in_log_time
from ._measure import Row, judged, noted
from .accuracy import data_folder

NREL, CASES = "relaxation-master", "cases"
TERMS = (1, 2, 3, 4)
LARGER = 1.1
"""A spectrum over the freest, which fits noise, too: 35 terms for 206 rows are 9 %."""
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
    omega, both = 2 * np.pi * f, storage + 1j * loss
    alone, together = (spectrum(Response(omega, y, "modulus")) for y in (storage, both))
    told = any("contradict" in note for note in together.notes)
    return [
        judged("master curve over time, rms of the reading, %", 100 * found.row.rms, 0.12),
        judged("the same, seconds of the processor", seconds, 1.0),
        noted("the same, terms", found.order),
        judged("the same with 8 terms, rms, % (greedy search: 3.7)", _short(response, 8), 3.7),
        _beside_freest(
            "storage moduli over frequency", alone.row.rms, _freest(omega, storage), 0.5
        ),
        _beside_freest(
            "storage and loss moduli together", together.row.rms, _freest(omega, both), 0.5
        ),
        judged("it says that these contradict each other", float(told), 1.0, at_least=True),
        *_raw(folder),
    ]


def _freest(omega: np.ndarray, y: np.ndarray) -> float:
    """Per cent of the reading left by 300 terms without a prior: no non-negative spectrum leaves less."""
    tau = np.geomspace(1e-4 / omega.max(), 1e4 / omega.min(), 300)
    terms = 1j * omega[:, None] * tau
    columns = np.hstack([np.ones((len(y), 1)), terms / (1 + terms)]) / np.abs(y)[:, None]
    parts = ("real", "imag") if np.iscomplexobj(y) else ("real",)
    A, b = (np.concatenate([getattr(x, part) for part in parts]) for x in (columns, y / np.abs(y)))
    return float(100 * scipy.optimize.nnls(A, b)[1] / np.sqrt(len(b)))


def _beside_freest(what: str, rms: float, freest: float, asked: float) -> Row:
    """Judged by what was asked, or where no spectrum reaches that by the freest one."""
    said = f"{what}, rms, % ({asked:g} asked, 300 free terms leave {freest:.3g})"
    return judged(said, 100 * rms, max(asked, LARGER * freest))


def _short(response: Response, terms: int) -> float:
    return 100 * spectrum(response, terms=terms).row.rms


def _raw(folder: Path) -> list[Row]:
    """Raw rows of one test at 21 temperatures, as moduli and as relaxation at 1 / f, to master curves.

    The factors published with the master curve over frequency are of another material.
    """
    found = []
    published = _table(folder / NREL / "time_user_raw__shift_factors.csv")[::-1]
    for name, what in (
        ("time_user_raw", "raw rows over time"),
        ("freq_user_raw", "raw storage and loss moduli"),
    ):
        table = _table(folder / NREL / f"{name}.csv")
        sets = [table[table[:, -1] == k] for k in np.unique(table[:, -1])]
        sets = [one[np.argsort(one[:, 0])] for one in sets]
        moduli = not name.startswith("time")
        parts = [
            Response(2 * np.pi * one[:, 0], one[:, 1] + 1j * one[:, 2], "modulus")
            if moduli
            else Response(one[:, 0], one[:, 1], "relaxation")
            for one in sets
        ]
        begin = time.perf_counter()
        curve = master_curve(parts, [float(one[:, -2].mean()) for one in sets], 3.0)
        seconds, log_a = time.perf_counter() - begin, curve.shifts.log_a
        apart = np.abs(log_a - published[:, 1])
        worst = float(np.max(apart / np.maximum(curve.shifts.error, 1e-3)))
        what, rms = f"{what} to a master curve", curve.spectrum.row.rms
        row = judged(f"{what}, rms of the reading, %", 100 * rms, 1.0)
        if moduli:
            omega = np.concatenate([one.t * 10**a for one, a in zip(parts, log_a, strict=True)])
            freest = _freest(omega, np.concatenate([one.y for one in parts]))
            row = _beside_freest(what, rms, freest, 1.0)
        found += [
            row,
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
