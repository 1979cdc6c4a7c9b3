"""Material cards of finite-element programs from a relaxing model: Prony terms as each program wants them.

A test in tension gives E(t), one in shear G(t); with a Poisson's ratio that does not change with time

    G(t) = E(t) / (2 (1 + nu)),    K(t) = E(t) / (3 (1 - 2 nu)),

so that all moduli have the same relative terms. A card with shear terms alone keeps its bulk modulus.
Sources: the manuals of the programs, see docs/from-a-rheometer-to-abaqus.md.
"""

import re
from collections.abc import Callable, Iterator
from textwrap import wrap
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from hysteresis import AbstractModel, BoucWen, InputError, MonotoneCurve, PrandtlIshlinskii, Sum
from hysteresis.models._viscoelastic import AbstractViscoelastic

Terms = Float[np.ndarray, " terms"]


class Prony(NamedTuple):
    """E(t) = long_term + sum of E exp(-t / tau) in tension, and what a card needs besides.

    - `poisson`; `unit` of the moduli, `time_unit` of the times; `name` of the material.
    - `wlf`: reference (degC), C1 and C2 (K) of the shift factors, log10 a = -C1 (T - Tr) / (C2 + T - Tr).
    """

    long_term: float
    E: Terms
    tau: Terms
    poisson: float
    unit: str
    time_unit: str
    name: str
    wlf: tuple[float, float, float] | None = None

    @property
    def at_once(self) -> float:
        """E(0)."""
        return float(self.long_term + self.E.sum())

    @property
    def terms(self) -> list[tuple[float, float]]:
        """E and tau of each."""
        return list(zip(self.E, self.tau, strict=True))

    @property
    def relative(self) -> list[tuple[float, float]]:
        """E over E(0), and tau, of each."""
        return list(zip(self.E / self.at_once, self.tau, strict=True))

    def shear(self, modulus: float) -> float:
        """Of a modulus in tension the one in shear."""
        return modulus / (2 * (1 + self.poisson))

    def bulk(self, modulus: float) -> float:
        """Of a modulus in tension the one under pressure."""
        return modulus / (3 * (1 - 2 * self.poisson))


class Card(NamedTuple):
    """The text of a card, and what it does not hold."""

    text: str
    notes: tuple[str, ...]


def material_card(
    program: str,
    model: AbstractModel,
    *,
    poisson: float = 0.45,
    shear: bool = False,
    unit: str = "1",
    time_unit: str = "s",
    name: str = "hysid",
    scale: float = 1.0,
    wlf: tuple[float, float, float] | None = None,
) -> Card:
    """The card of a relaxing model for a finite-element program.

    **Arguments:**

    - `program`: "abaqus", "apdl" or "mpl" (Ansys), "comsol", "ls-dyna", "openradioss", "calculix", "febio",
      "opensees".
    - `model`: viscoelastic: a generalised Maxwell or Kelvin-Voigt chain, a standard linear solid, Burgers.
      For OpenSees also Bouc-Wen, Prandtl-Ishlinskii that leads its input, a monotone curve, or a sum.
    - `poisson`: Poisson's ratio, between -1 and 0.5, the same at all times.
    - `shear`: whether the model's modulus is a shear modulus, and not one in tension.
    - `unit`, `time_unit`, `name`: of the moduli, of the times, of the material. `scale`: by what the
      model's moduli are multiplied to be in `unit`.
    - `wlf`: reference temperature (degC), C1 and C2 (K) of shift factors by the law of Williams, Landel
      and Ferry.

    Raises `InputError` `bad-option` for an unknown program or Poisson's ratio, `not-exportable` for a model
    that has no relaxation modulus or more terms than the program holds.

    **Example:**

        >>> relaxing = hysteresis.GeneralizedMaxwell(1.0, [3.0], [10.0])
        >>> print(compensate.material_card("abaqus", relaxing, poisson=0.4).text.splitlines()[-1])
        0.75, 0.75, 10
    """
    if program not in CARDS:
        raise InputError("bad-option", f"No cards for {program!r}.", fix=f"{', '.join(CARDS)}.")
    name = re.sub(r"[^\w.]+", "_", name) or "hysid"  # what every program takes in a name
    written = f"Material {name}, written by hysid: moduli in {unit}, times in {time_unit}."
    if program == OPENSEES:
        lines, said = _opensees(model)
        return _card([written.replace("moduli", "forces per deformation"), *said], lines, "# {}")
    if not -1 < poisson < 0.5:
        raise InputError(
            "bad-option",
            f"A Poisson's ratio of {poisson:g}.",
            fix="give one below 0.5, such as 0.49.",
        )
    write, most, comment = PROGRAMS[program]
    long_term, E, tau = prony_of(model)
    if len(E) > most:
        raise InputError(
            "not-exportable",
            f"The model has {len(E)} terms, and a card for {program} holds {most}.",
            fix=f"Fit a shorter series (--terms {most}).",
        )
    if not len(E):
        raise InputError(
            "not-exportable",
            "The model does not relax: it has no terms.",
            fix="Fit a relaxing one.",
        )
    scale *= 2 * (1 + poisson) if shear else 1.0
    terms = Prony(scale * long_term, scale * E, tau, poisson, unit, time_unit, name, wlf)
    lines, notes = write(terms)
    said = [f"Poisson's ratio {poisson:g} is assumed, and the same at all times.", *notes]
    if terms.long_term <= 1e-9 * terms.at_once:
        said.append("No stiffness is left in the end, as in a liquid: some solvers refuse that.")
    if wlf is not None and program not in HOLD_SHIFTS:
        said.append(
            "The card does not hold the shift factors: it is for the reference temperature."
        )
    return _card([written, *said], lines, comment)


def _card(told: list[str], lines: list[str], comment: str) -> Card:
    """A card, its head in comments; all told but the first sentence are notes."""
    head = [comment.format(line) for one in told for line in wrap(one, 76)] if comment else []
    return Card("\n".join([*head, *lines, ""]), tuple(told[1:]))


def prony_of(model: AbstractModel) -> tuple[float, Terms, Terms]:
    """Long-term modulus, terms and times of a relaxation modulus. Raises `InputError` `not-exportable`."""
    if not isinstance(model, AbstractViscoelastic):
        raise InputError(
            "not-exportable",
            f"{type(model).__name__} has no relaxation modulus.",
            fix="Fit --step, --hold, --frequency, or --model GeneralizedMaxwell.",
        )
    if model.creeps and not float(model.chain().direct) > 0:
        raise InputError(
            "not-exportable",
            "The model has no spring, so its stiffness at once is infinite.",
            fix="Fit with a spring, or relaxation instead of creep.",
        )
    chain = model.driven_by_force(False)
    direct, rates, drives = map(np.asarray, (chain.direct, chain.all_rates, chain.all_drives))
    there = (rates > 0) & (drives != 0)
    E, tau = -drives[there] / rates[there], 1 / rates[there]
    order = np.argsort(tau)
    return max(float(direct - E.sum()), 0.0), E[order], tau[order]


Written = tuple[list[str], list[str]]
"""Lines of a card, and what it does not hold."""
RELATIVE = "Terms are relative to the modulus at once, the same in shear and bulk."
DENSITY = "The density is 1: put in your own."


def _row(*values: float) -> str:
    return ", ".join(f"{x:.12g}" for x in values)


def _wide(*values: float) -> str:
    """Fields of twenty characters."""
    return "".join(f"{x:>20.12g}" for x in values)


def _abaqus(p: Prony) -> Written:
    lines = [f"*MATERIAL, NAME={p.name}", "*ELASTIC, MODULI=INSTANTANEOUS"]
    lines += [_row(p.at_once, p.poisson), "*VISCOELASTIC, TIME=PRONY"]
    lines += [_row(g, g, t) for g, t in p.relative]
    lines += ["*TRS, DEFINITION=WLF", _row(*p.wlf)] if p.wlf is not None else []
    return lines, [RELATIVE]


def _apdl(p: Prony) -> Written:
    lines = [f"MP,EX,1,{p.at_once:.12g}", f"MP,NUXY,1,{p.poisson:.12g}"]
    for part in ("SHEAR", "BULK"):
        lines += [f"TB,PRONY,1,1,{len(p.E)},{part}", *_tbdata(p, 6)]
    if p.wlf is not None:
        lines += ["TB,SHIFT,1,1,3,WLF", f"TBDATA,1,{_row(*p.wlf)}"]
    return lines, [RELATIVE]


def _mpl(p: Prony) -> Written:
    lines = ["/NOP", "TBDEL,ALL,_MATL", "MPDEL,ALL,_MATL"]
    for part in ("SHEA", "BULK"):
        lines += [f"TB,PRON,_MATL   ,   1,{len(p.E):4d},{part}", "TBFIELD,Temps,0.000000"]
        lines += _tbdata(p, 3)
    lines += ["MPTEMP,1,0.000000", f"MPDATA,EX,_MATL,1,{p.at_once:.12g}"]
    return [*lines, f"MPDATA,NUXY,_MATL,1,{p.poisson:.12g}", "/GO"], [RELATIVE]


def _tbdata(p: Prony, together: int) -> list[str]:
    """Relative terms and times in turn, so many on a line."""
    values = [f"{x:.12g}" for pair in p.relative for x in pair]
    parts = [(k, values[k : k + together]) for k in range(0, len(values), together)]
    return [f"TBDATA,{k + 1},{','.join(part)}" for k, part in parts]


def _comsol(p: Prony) -> Written:
    unit = "" if p.unit == "1" else f"[{p.unit}]"
    lines = [
        f'E_inf {p.long_term:.12g}{unit} "Long-term modulus"',
        f'nu {p.poisson:.12g} "Poisson\'s ratio"',
    ]
    for k, (E, tau) in enumerate(p.terms, start=1):
        lines += [
            f'G{k} {p.shear(E):.12g}{unit} "Shear modulus of branch {k}"',
            f'K{k} {p.bulk(E):.12g}{unit} "Bulk modulus of branch {k}"',
            f'tau{k} {tau:.12g}[{p.time_unit}] "Relaxation time of branch {k}"',
        ]
    if p.wlf is not None:
        T, C1, C2 = p.wlf
        lines += [
            f'T_WLF {T:.12g}[degC] "Reference temperature"',
            f'C1_WLF {C1:.12g} "First constant"',
            f'C2_WLF {C2:.12g}[K] "Second constant"',
        ]
    return lines, [
        "Load the file under Parameters. E_inf and nu are the long-term elastic properties, G and tau the"
        " branches of a generalised Maxwell model; take K where volumes relax too."
    ]


def _ls_dyna(p: Prony) -> Written:
    lines = [
        "*MAT_GENERAL_VISCOELASTIC+",
        "$ MID, RO, BULK, PCF, EF, TREF, A, B",
        _wide(1, 1, p.bulk(p.at_once), 0, 0, 0, 0, 0),
        "$ LCID, NT, BSTART, TRAMP, LCIDK, NTK, BSTARTK, TRAMPK",
        _wide(*[0] * 8),
        "$ GI, BETAI",
        _wide(p.shear(p.long_term), 0),
        *(_wide(p.shear(E), 1 / tau) for E, tau in p.terms),
    ]
    return lines, [
        "Terms are shear moduli; the one that stays has the decay 0. The bulk modulus is that at once and"
        " does not relax.",
        DENSITY,
    ]


def _openradioss(p: Prony) -> Written:
    lines = ["/MAT/LAW1/1", p.name, _wide(1), _wide(p.long_term, p.poisson)]
    lines += ["/VISC/PRONY/1", f"{len(p.E):>10d}{0:>20d}{0:>10d}{0:>10d}"]
    lines += [_wide(p.shear(E), 1 / tau, p.bulk(E), 1 / tau) for E, tau in p.terms]
    return lines, [
        "Terms are moduli beside the long-term elastic law. Where LAW1 is refused beside /VISC/PRONY, put"
        " the long-term modulus into LAW42 or LAW70.",
        DENSITY,
    ]


def _calculix(p: Prony) -> Written:
    lines = []
    if p.long_term:
        lines += [f"*MATERIAL, NAME={p.name}-0", "*ELASTIC", _row(p.long_term, p.poisson)]
    for k, (E, tau) in enumerate(p.terms, start=1):
        lines += [f"*MATERIAL, NAME={p.name}-{k}", "*ELASTIC", _row(E, p.poisson)]
        lines += ["*CREEP, LAW=NORTON", _row(1 / (E * tau), 1.0, 0.0)]
    return lines, [
        "CalculiX has no Prony series: every term is a material that creeps. Give each its own copy of the"
        " elements on the same nodes, so that their stresses add, and use *VISCO steps. Volume does not"
        " creep, so the card is exact in tension alone."
    ]


def _febio(p: Prony) -> Written:
    terms = [*enumerate(p.relative, start=1)]
    lines = [
        f'<material id="1" name="{p.name}" type="viscoelastic">',
        f"  <g0>{p.long_term / p.at_once:.12g}</g0>",
        *(f"  <g{k}>{g:.12g}</g{k}>" for k, (g, _) in terms),
        *(f"  <t{k}>{tau:.12g}</t{k}>" for k, (_, tau) in terms),
        '  <elastic type="neo-Hookean">',
        f"    <density>1</density><E>{p.at_once:.12g}</E><v>{p.poisson:.12g}</v>",
        "  </elastic>",
        "</material>",
    ]
    return lines, [
        "Terms are relative to the modulus at once, which the elastic material has: neo-Hookean, whose"
        " strains may be large.",
        DENSITY,
    ]


def _opensees(model: AbstractModel) -> Written:
    """`uniaxialMaterial` lines of OpenSees: material 1 has the force of a deformation, the sum of the
    others where one is not enough."""
    made = [*_materials(model)]
    tags = range(2, 2 + len(made)) if len(made) > 1 else (1,)
    pairs = zip(tags, made, strict=True)
    lines = [f"uniaxialMaterial {name} {tag} {values}" for tag, (name, values) in pairs]
    if len(made) > 1:
        lines.append(f"uniaxialMaterial Parallel 1 {' '.join(map(str, tags))}")
    force = float(np.asarray(model.simulate(np.arange(2.0), np.zeros(2)))[0])
    notes = ["Material 1 takes the deformation that the fit had as its input."]
    if any(name == "Maxwell" for name, _ in made):
        notes.append("Maxwell materials need a transient analysis, whose time is that of the fit.")
    if abs(force) > 1e-12:
        notes.append(f"The force at no deformation, {force:.6g}, is left out.")
    return lines, notes


def _materials(model: AbstractModel) -> Iterator[tuple[str, str]]:
    """Names of materials, and what comes after their tags."""
    if isinstance(model, Sum):
        for part in model.parts:
            yield from _materials(part)
    elif isinstance(model, AbstractViscoelastic):
        at_end, E, tau = prony_of(model)
        if at_end > 0:
            yield "Elastic", _words(at_end)
        for stiffness, time in zip(E, tau, strict=True):
            yield "Maxwell", _words(stiffness, stiffness * time, 1.0, 1.0)
    elif isinstance(model, BoucWen):
        beta, gamma = model.coefficients()
        yield "BoucWen", _words(model.alpha, model.k, model.n, gamma, beta, 1, 0, 0, 0)
    elif isinstance(model, MonotoneCurve):
        u = jnp.asarray(model.nodes)
        force = model.curve(u) - model.curve(jnp.zeros(1))
        yield "ElasticMultiLinear", f"-strain {_words(*u)} -stress {_words(*force)}"
    elif (
        isinstance(model, PrandtlIshlinskii)
        and model.leading
        and model.rates is None
        and model.bends is None
    ):
        yield "Elastic", _words(model.slope)
        for weight, radius in zip(model.weights, model.thresholds, strict=True):
            if weight > 0:
                yield "ElasticPP", _words(weight, radius)
    else:
        raise InputError(
            "not-exportable",
            f"No material of OpenSees is a {type(model).__name__} as it was fitted.",
            fix="Fit --model BoucWen, PrandtlIshlinskii (force over deformation), or a relaxing one.",
        )


def _words(*values: Any) -> str:
    return " ".join(f"{float(x):.12g}" for x in values)


ANY = 10_000
"""More terms than any fit has."""
HOLD_SHIFTS = ("abaqus", "apdl", "comsol")
"""Programs whose cards hold the law of Williams, Landel and Ferry."""
PROGRAMS: dict[str, tuple[Callable[[Prony], Written], int, str]] = {
    "abaqus": (_abaqus, ANY, "** {}"),
    "apdl": (_apdl, ANY, "! {}"),
    "mpl": (_mpl, ANY, "/COM, {}"),
    "comsol": (_comsol, ANY, ""),
    "ls-dyna": (_ls_dyna, 17, "$ {}"),
    "openradioss": (_openradioss, 100, "# {}"),
    "calculix": (_calculix, ANY, "** {}"),
    "febio": (_febio, 6, "<!-- {} -->"),
}
"""What writes each card, the most terms that it holds (one of LS-DYNA's 18 stays), and its comments."""

OPENSEES = "opensees"
CARDS = (*PROGRAMS, OPENSEES)
"""Programs that have cards; that of OpenSees has other models too."""
