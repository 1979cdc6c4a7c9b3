"""Report sections on moduli over frequency and on several temperatures: the master curve, its pieces."""

import numpy as np

import identify
from identify.results._detail import DiscreteSpectrum
from identify.spectra._superposition import Shifts

from ..figures import _base as f
from ..figures._format import number, quantity
from ..figures._survey import clock_of, master_of, pieces_of, shift_factors
from ._case import Case, Section, Table


def curve(case: Case) -> Section:
    """The master curve with its pieces; with temperatures the shifts, their law and what is left over."""
    detail = case.fit.detail
    assert isinstance(detail, DiscreteSpectrum)
    moduli = identify.internal.is_moduli(case.fit.train)
    section = Section("Moduli" if moduli else "Master curve")
    caption = "Measured rows, and lines of the spectrum."
    if detail.shifts is not None:
        caption += " Every temperature is shifted along the axis by its factor."
    section.draw(master_of(case.fit), f"{case.output}: measured rows and the spectrum", caption)
    if detail.shifts is not None:
        _shifts(section, detail.shifts)
    return section


def _shifts(section: Section, shifts: Shifts) -> None:
    names = ("C1", "C2 in K") if shifts.law == "WLF" else ("activation energy in kJ/mol",)
    told = ", ".join(f"{n} {number(x)}" for n, x in zip(names, shifts.constants, strict=True))
    caption = (
        f"Shift factors with standard errors. {shifts.law}: {told}, from {number(shifts.reference)} °C."
        f" The factors lie {number(shifts.law_error)} decades rms from it."
    )
    section.draw(shift_factors(shifts), "Shift factors over temperature", caption)
    columns = shifts.temperature, shifts.log_a, shifts.error, shifts.left, shifts.alone
    rows = [
        (number(T), number(a), number(e), quantity(100 * left, "%"), quantity(100 * alone, "%"))
        for T, a, e, left, alone in zip(*columns, strict=True)
    ]
    said = "Shift factors, and what the spectrum of all temperatures leaves beside one of each."
    heads = ("Temperature, °C", "log10 a", "Standard error", "Left over",
             "By a spectrum of its own")  # fmt: skip
    section.tables.append(Table(said, heads, rows))


def residuals(case: Case) -> Section:
    """Residuals in per cent of the reading over the reduced clock."""
    colours = {"storage": f.BLUE, "loss": f.VERMILLION}
    curves: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {}
    for piece, residual in pieces_of(case.fit):
        curves.setdefault(piece.part, []).append((np.log10(piece.x), 100 * residual))
    drawn = []
    for part, parts in curves.items():
        x, y = (np.concatenate(one) for one in zip(*parts, strict=True))
        drawn.append(f.Curve(part, x, y, colours.get(part, f.BLUE), "dots"))
    x_label, y_label = f"log10 of {clock_of(case.fit)}", "residual / size of the modulus (%)"
    figure = f.chart(drawn, x_label, y_label, zero=True)
    section = Section("Residuals")
    caption = "Pieces that lie beside each other are not described by one spectrum."
    section.draw(figure, "Relative residuals", caption)
    return section
