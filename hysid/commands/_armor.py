"""`hysid armor`: from tables of presses and wrenches to contacts, and a page that shows them."""

from collections import Counter
from dataclasses import asdict
from functools import partial
from itertools import combinations_with_replacement
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import identify
from compensate.armor import Armor, ContactStatus, export_armor
from compensate.armor._armor import UncertainArmor, UncertainContact
from hysteresis import AbstractModel, InputError
from hysteresis._files import write_table
from hysteresis._limits import damage_told, load_arrays
from hysteresis._quantities import conversion
from hysteresis._serialisation import described, rebuilt

from .._catalogue import is_synthetic
from ..armor._calibration import CalibratedArmor, calibrate_armor
from ..armor._files import Description, read_description, read_presses, read_rows, read_wrenches
from ..armor._touches import FILE as TOUCHES
from ..armor._touches import VIRTUAL, replay, save_touches, shell_of
from ._asked_more import Calibrate, Solve, View
from ._console import Done, warnings

DOCUMENT, ARRAYS = "calibration.json", "calibration.npz"
RUNTIME, CONTACTS = "armor.json", "contacts.csv"
SCHEMA, DRAWS = 1, 100
UNLIKELY = 4.0
"""Standard deviations: of 50 values one is farther off by chance in one calibration of 300."""
MANY = 0.1
"""Of the loads: of a sensor with a wrong sign, those on one side in five of a box pull."""
UNCALIBRATED = (
    "Without a calibration the covariance holds the noise of the readings and the error of the sponge's fit"
    " alone, not what the sensor itself is off by (hysid armor calibrate)."
)


def calibrate(asked: Calibrate) -> Done:
    """Calibrate an armor by presses at known points; write it to a folder, and what runs without JAX.

    Raises `InputError` for tables, shapes and fits that cannot be used, and where results are there.
    """
    out, overwrite = asked.out, asked.overwrite
    for name in (DOCUMENT, RUNTIME):
        identify.internal.check_free(out, overwrite, name)
    known, fit = read_description(asked.shape), identify.load(asked.sponge)
    material = fit.model
    armor = known.armor(material)
    table, seen = read_rows(asked.file)
    made = read_presses(table, armor.solver.shape)
    noise = np.asarray(known.noise_of_wrench)
    scatter = max(1e-4, _scatter(fit))
    found = calibrate_armor(armor, made, noise=noise, scatter=scatter)
    structure, arrays = described(material)
    draws = [np.asarray(leaf) for leaf in jax.tree.leaves(found.uncertain.draws)]
    arrays |= {f"armor.{k}": np.asarray(x) for k, x in enumerate(jax.tree.leaves(found.armor))}
    arrays |= {f"draws.{k}": x for k, x in enumerate(draws)}
    arrays |= {"noise": np.asarray(found.uncertain.noise)}
    words = asdict(known)
    for name in ("corners", "triangles"):
        if words[name] is not None:
            arrays[name] = np.asarray(words.pop(name))
    document: dict[str, Any] = {
        "schema": SCHEMA, "structure": structure, "armor": words,
        "scatter": float(found.uncertain.scatter), "noise": arrays["noise"].tolist(),
        "presses": len(made.surface), "table": found.calibration.text,
    }  # fmt: skip
    document["armor"]["thickness"] = None if np.isinf(known.thickness) else known.thickness
    identify.internal.write_set(
        out, DOCUMENT, document, {ARRAYS: arrays},
        remove=(RUNTIME,), check=partial(identify.internal.check_free, out, overwrite, DOCUMENT),
    )  # fmt: skip
    runtime, notes = _exported(found.armor, out / RUNTIME, material)
    notes = [*seen, *_unlikely(found), *notes]
    told: dict[str, Any] = {k: document[k] for k in ("presses", "table", "noise", "scatter")}
    told |= {"folder": str(out), "runtime": runtime, "notes": notes}
    said = f"Elsewhere the cover's depth is uncertain by {1e3 * told['scatter']:.2g} mm."
    if made.displacement is None:
        said = "No column displacement tells the cover's depth, so it is as uncertain as before."
    return Done(told, [*warnings(notes), told["table"], said, f"Armor: {out}"])


def solve(asked: Solve) -> Done:
    """Contacts behind the wrenches of a table, with covariance and status; a folder with all of it.

    Raises `InputError` for tables, shapes and fits that cannot be used, `no-time` for a stream without a
    clock and for a cover that creeps without a stream, and where results are there.
    """
    out, stream = asked.out, asked.stream
    for name in (CONTACTS, RUNTIME):  # the armor of a calibration is not written over either
        identify.internal.check_free(out, asked.overwrite, name)
    if [asked.sponge, asked.shape].count(None) != (0 if asked.calibrated is None else 2):
        raise InputError(
            "conflicting-options", "Nothing says what the armor is, or two things do.",
            fix="Give --sponge DIR and --shape FILE, or --armor DIR of a calibration.",
        )  # fmt: skip
    if asked.calibrated is not None:
        uncertain, material = load_calibration(asked.calibrated)
    else:
        assert asked.sponge is not None
        assert asked.shape is not None
        known = read_description(asked.shape)
        fit = identify.load(asked.sponge)
        material = fit.model
        # Only the noise and the error of the sponge's fit are known to be off.
        armor = known.armor(material)
        draws = eqx.tree_at(lambda a: a.sensor.bias, armor, jnp.zeros((DRAWS, 6)))
        uncertain = UncertainArmor(armor, draws, known.noise_of_wrench, _scatter(fit))
    rows, seen = read_rows(asked.file)
    table = read_wrenches(rows)
    if stream and (table.time is None or not np.all(np.diff(table.time) >= 0)):
        raise InputError(
            "no-time", "A stream needs a time of every wrench, none before the last.",
            place=str(asked.file),
            fix="mend the column time (s), or solve each wrench by itself (without --stream).",
        )  # fmt: skip
    readings = jnp.asarray(table.readings)
    solve_all = partial(uncertain.simulate, table.time) if stream else uncertain.solve
    found = solve_all(readings, table.motion)
    contact, covariance = found.contact, np.asarray(found.covariance)
    known_place = (np.asarray(contact.surface) > 0)[:, None, None] & np.isfinite(covariance)
    covariance = np.where(known_place, covariance, np.nan)
    out.mkdir(parents=True, exist_ok=True)
    _write_contacts(out / CONTACTS, table.time, table.line, found, covariance)
    wrench = uncertain.armor.sensor.read(readings, table.motion)
    time = np.arange(float(len(readings))) if table.time is None else table.time
    title = asked.file.name + (VIRTUAL if is_synthetic(table.sha256) else "")
    save_touches(
        out, shell_of(uncertain.armor.solver.shape), time, np.asarray(wrench.force),
        np.asarray(wrench.moment), contact, title=title, covariance=covariance,
    )  # fmt: skip
    runtime, notes = _exported(uncertain.armor, out / RUNTIME, material)
    if asked.calibrated is None:
        notes = [UNCALIBRATED, *notes]
    counts = Counter(ContactStatus(int(s)).name for s in np.asarray(contact.status))
    notes = [*seen, *_impossible(counts), *notes]
    said = ", ".join(f"{count} {name}" for name, count in counts.items())
    told = {
        "rows": len(readings), "statuses": counts, "stream": stream, "file": str(out / CONTACTS),
        "touches": str(out / TOUCHES), "runtime": runtime, "notes": notes,
    }  # fmt: skip
    return Done(told, [*warnings(notes), f"{len(readings)} wrenches: {said}", told["file"]])


def view(asked: View) -> Done:
    """The page that replays contacts."""
    found = replay(asked.folder)
    return Done(found, [found["file"]])


def load_calibration(folder: Path) -> tuple[UncertainArmor, AbstractModel]:
    """The armor that `calibrate` wrote, with its draws, and the model of its cover.

    Raises `InputError` where the folder holds none, or it is damaged.
    """
    make = "make one: hysid armor calibrate PRESSES.csv --sponge DIR --shape FILE --out DIR."
    document = identify.internal.read_checked(
        folder, DOCUMENT, SCHEMA, make=make, again="calibrate again."
    )
    with damage_told(DOCUMENT, folder, "Calibrate again."):
        arrays = load_arrays(identify.internal.whole_files(folder, document)[ARRAYS])
        material = rebuilt(document["structure"], arrays)
        words: dict[str, Any] = {
            k: tuple(v) if isinstance(v, list) else v for k, v in document["armor"].items()
        }
        words["thickness"] = np.inf if words["thickness"] is None else words["thickness"]
        words |= {k: arrays[k] for k in ("corners", "triangles") if k in arrays}
        known = Description(**words)
        leaves, tree = jax.tree.flatten(known.armor(material))
        names = [[f"{part}.{k}" for k in range(len(leaves))] for part in ("armor", "draws")]
        armor, draws = (tree.unflatten([jnp.asarray(arrays[k]) for k in own]) for own in names)
        noise, scatter = jnp.asarray(arrays["noise"]), document["scatter"]
    return UncertainArmor(armor, draws, noise, scatter), material


def _unlikely(found: CalibratedArmor) -> list[str]:
    """A warning where a value is so far from what was believed that no chance explains it."""
    point = np.abs(found.calibration.point)
    if (times := float(point.max())) < UNLIKELY:
        return []
    return [
        f"{found.calibration.parameters[int(point.argmax())].name} lies {times:.0f} of its prior"
        " deviations from what was believed: a sensor that is turned, reports the reaction, is clipped or"
        " has a dead channel, or columns that are swapped or in another unit."
    ]


def _impossible(counts: Counter[str]) -> list[str]:
    """A warning where many of the loads are such that no contact explains them."""
    loads = sum(counts[name] for name in ("OK", "MISSED", "PULLING", "AMBIGUOUS", "EXTRAPOLATED"))
    odd = counts["MISSED"] + counts["PULLING"]
    if odd <= MANY * loads:
        return []
    return [
        f"{odd} of {loads} loads pull or pass the shell by: columns that are swapped or in another unit,"
        " moments about another point than P_o, or a sensor that reports the reaction (reports ="
        ' "reaction" in the TOML file).'
    ]


def _scatter(fit: identify.FitResult) -> float:
    """How far a fit is off in m, on the rows that were held out, or else on those of the training."""
    figures = fit.metrics["test"] or fit.metrics["train"]
    record, units = fit.train, fit.model.units
    if figures is None or units is None:
        return 0.0
    metres = conversion(units.output, "m")
    if metres is None:
        # Of a force: as much as it makes where the sponge is as stiff as in the mean.
        used = record.mask
        slope = np.ptp(record.input[used]) / np.ptp(record.output[used])
        metres = (conversion(units.input, "m") or 0.0) * float(slope)
    return metres * figures.rmse


def _exported(armor: Armor, file: Path, material: AbstractModel) -> tuple[str | None, list[str]]:
    """The file for the runtime, or why there is none."""
    try:
        return str(export_armor(armor.solver, file, armor.sensor, model=material)), []
    except InputError as error:
        file.unlink(missing_ok=True)
        return None, [f"No {file.name} for the runtime without JAX: {error.problem}"]


def _write_contacts(
    file: Path, time: Any, line: np.ndarray, found: UncertainContact, covariance: np.ndarray
) -> None:
    contact = found.contact
    point = np.where(np.asarray(contact.surface)[:, None] > 0, contact.point, np.nan)
    columns: dict[str, Any] = {
        "line": line, "time (s)": [""] * len(line) if time is None else time,
        "status": [ContactStatus(int(s)).name for s in np.asarray(contact.status)],
        "surface": contact.surface, **{f"{axis} (m)": point[:, k] for k, axis in enumerate("xyz")},
        "displacement (m)": contact.displacement, "normal force (N)": contact.normal_force,
        "spin (N*m)": contact.spin, "outside (m)": contact.outside,
    }  # fmt: skip
    for i, j in combinations_with_replacement(range(3), 2):
        columns[f"{'xyz'[i]}{'xyz'[j]} (m^2)"] = covariance[:, i, j]
    columns["probability"] = found.probability
    rows = zip(*(np.asarray(column).tolist() for column in columns.values()), strict=True)
    write_table(file, columns, (["" if x != x else x for x in row] for row in rows))
