"""`hysid compare`: which model of the same data predicts best, or how one model's parameters changed."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import identify
from hysteresis import InputError
from hysteresis._show import aligned
from identify import compare_loops
from identify.comparison._compare import Pair
from identify.internal import Compared, compare_candidates

from ..figures._format import number, pretty
from ..reporting._specimens import places
from ._asked import Compare
from ._console import Done

DASH = "-"


def run(asked: Compare) -> Done:
    """Models of the same data ranked, or with `change` what changed from one to another."""
    if asked.change:
        return _change(asked.folders, asked.margin)
    return _groups(asked.folders) if asked.loops else _compare(asked.folders)


def _compare(folders: Sequence[Path]) -> Done:
    """Models of the same data, ranked by held-out error; of one folder, the candidates that were tried."""
    fits = _places(folders)
    alone = len(fits) == 1
    found = compare_candidates(*fits.values()) if alone else identify.compare(fits)
    document = {
        "models": [_figures(model) for model in found.models],
        "pairs": [_pair(pair) for pair in found.pairs],
        **{name: getattr(found, name) for name in ("best", "ranked_on", "notes")},
    }
    return Done(document, _comparison_lines(document))


def _check_two(folders: Sequence[Any], problem: str, fix: str) -> None:
    if len(folders) != 2:
        code = "too-few-fits" if len(folders) < 2 else "bad-option"
        raise InputError(code, problem, place=str(folders[0]), fix=fix)


def _change(folders: Sequence[Path], margin: float) -> Done:
    """One model on two data sets: what changed from the first to the second."""
    named = _places(folders)
    names, fits = list(named), list(named.values())
    given = f"{', '.join(names)} {'is' if len(fits) < 2 else 'are'} given"
    fix = "Name two folders in order of time: before, after."
    _check_two(fits, f"A change is between two fits; {given}.", fix)
    found = identify.change(*fits, margin=margin)
    same = ("left_out", "chi_square", "degrees", "p", "margin", "words")
    document: dict[str, Any] = {"models": names, "parameters": [*map(_told, found.parameters)]}
    document |= {name: getattr(found, name) for name in same}
    return Done(document, _change_lines(document))


def _groups(folders: Sequence[Path]) -> Done:
    """Two groups of specimens, by the measured loops of their fits."""
    fix = "Name two folders of hysid fit --each."
    _check_two(folders, "Loops are compared between two groups of specimens.", fix)
    groups = [[identify.load(place).loops() for place in _places([f]).values()] for f in folders]
    found = compare_loops(*groups)
    names, counts = [*map(str, folders)], [*map(len, groups)]
    document = {"groups": names, "specimens": counts, "figures": [*map(_told, found)]}
    return Done(document, _group_lines(document))


def _group_lines(document: dict[str, Any]) -> list[str]:
    """A table of figures, and which of them differ."""
    told = [row for row in document["figures"] if row["p"] is not None]
    columns = {
        "figure": [row["name"] for row in told],
        **_differences(told, {"first": "one", "second": "other"}),
        "p": [_chance(row["p"]) for row in told],
        "needed": [DASH if row["needed"] is None else str(row["needed"]) for row in told],
    }
    clear = "; ".join(row["name"] for row in told if row["clear"]) or "no figure"
    groups = zip(document["groups"], document["specimens"], strict=True)
    head = " and ".join(f"{n} of {name}" for name, n in groups)
    if not told:
        return [f"{head}: nothing is told. {document['figures'][0]['reason'].capitalize()}."]
    needed = "Needed: specimens a group that would show such a difference."
    return [head, "", *_table(columns), "", f"Clearly different: {clear}. {needed}"]


def _comparison_lines(document: dict[str, Any]) -> list[str]:
    """A table of models, the best first, and what can be said of each pair."""
    where = {"held-out": "held-out blocks", "test": "the test record"}[document["ranked_on"]]
    models = document["models"]
    columns = {
        "": [str(k) for k in range(1, len(models) + 1)],
        "model": [model["name"] for model in models],
        "held-out": _percents(models, "held_out_percent"),
        "test": _percents(models, "test_percent"),
        "parameters": [DASH if m["numbers"] is None else str(m["numbers"]) for m in models],
        "AIC": _from_best(models, "aic", min),
        "BIC": _from_best(models, "bic", min),
        "log evidence": _from_best(models, "log_evidence", max),
    }
    lines = [f"Ranked by {where}: error in per cent of the output's range.", ""]
    lines += [*_table(columns), ""]
    lines += [said for pair in document["pairs"] for said in pair["words"]]
    return lines + [f"Note: {note}" for note in document["notes"]]


def _change_lines(document: dict[str, Any]) -> list[str]:
    """A table of parameters, and what can be said of them."""
    listed = document["parameters"]
    columns = {
        "parameter": [p["name"] for p in listed],
        **_differences(listed, {"before": "before", "after": "after"}),
        "": [_part(p["difference"], p["before"]) for p in listed],
        "p": [_chance(p["p_holm"]) for p in listed],
    }
    return [" -> ".join(document["models"]), "", *_table(columns), "", *document["words"]]


def _differences(rows: list[dict[str, Any]], sides: dict[str, str]) -> dict[str, list[str]]:
    """Units, both sides and their difference with its error."""
    return {
        "unit": [pretty(row["unit"]) or "1" for row in rows],
        **{name: [number(row[key], row["error"]) for row in rows] for name, key in sides.items()},
        "difference": [f"{number(row['difference'])} ± {row['error']:.2g}" for row in rows],
    }


def _chance(p: float) -> str:
    return "< 0.0001" if p < 1e-4 else f"{p:.2g}"


def _places(folders: Sequence[Path]) -> dict[str, Path]:
    """Folders by name; one that holds several fits stands for those."""
    found = places(folders)
    if len(found) < len(folders):
        raise InputError("given-twice", "A folder is named twice.", fix="Name each folder once.")
    return found


def _figures(model: Compared) -> dict[str, Any]:
    said = {"held_out": "held_out_percent", "test": "test_percent"}
    kept = {k: v for k, v in model._asdict().items() if not k.endswith("blocks")}
    return {said.get(name, name): value for name, value in kept.items()}


def _pair(pair: Pair) -> dict[str, Any]:
    told = {
        name: one and _told(one) for name, one in (("held_out", pair.held_out), ("test", pair.test))
    }
    return {"one": pair.one, "other": pair.other, **told, "words": pair.words}


def _told(one: Any) -> dict[str, Any]:
    """The fields of a difference, and whether it is clear."""
    return one._asdict() | {"clear": one.clear}


def _percents(models: list[dict[str, Any]], key: str) -> list[str]:
    return [DASH if m[key] is None else f"{number(m[key])} %" for m in models]


def _from_best(models: list[dict[str, Any]], key: str, best: Callable[..., float]) -> list[str]:
    """Differences to the best one, since nothing else of these figures means anything."""
    known = [m[key] for m in models if m[key] is not None]
    if len(known) < 2:
        return [DASH] * len(models)
    return [DASH if m[key] is None else _signed(m[key] - best(known)) for m in models]


def _part(difference: float, of: float) -> str:
    return DASH if of == 0 else f"{_signed(100 * difference / abs(of))} %"


def _signed(x: float) -> str:
    return f"{x:+.1f}".replace("-", "−") if round(x, 1) else "0"


def _table(columns: dict[str, list[str]]) -> list[str]:
    """Columns under their names, the first two to the left; those without a figure left out."""
    kept = {name: cells for name, cells in columns.items() if set(cells) != {DASH}}
    return aligned([list(kept), *zip(*kept.values(), strict=True)], range(2, len(kept)))
