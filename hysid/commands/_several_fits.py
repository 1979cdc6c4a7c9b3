"""Several fits as one document: mean figures, the most frequent model, the worst verdict."""

from collections import Counter
from typing import Any

import numpy as np

from hysteresis._verdict import worst_of


def together(documents: dict[str, dict[str, Any]], failed: dict[str, str]) -> dict[str, Any]:
    """One document for several fits: mean figures, the most frequent model, the worst verdict."""
    each = list(documents.values())
    first, whole = each[0], _in_common(documents)
    model = Counter(d["model"] for d in each).most_common(1)[0][0]
    candidates = []
    for name in dict.fromkeys(c["model"] for d in each for c in d["candidates"]):
        tried = {v: c for v, d in documents.items() for c in d["candidates"] if c["model"] == name}
        candidates.append(
            {"model": name, "parameters": _mean_parameters([*tried.values()]), **_in_common(tried)}
        )
    if failed:
        level = worst_of((whole["verdict"]["level"], "CAUTION"))
        reasons = [
            {"code": "not-fitted", "text": f"{v}: not fitted. {why}"} for v, why in failed.items()
        ]
        reasons = whole["verdict"]["reasons"] + reasons
        whole |= {"success": False, "trusted": False}
        whole["verdict"] |= {"level": level, "reasons": reasons}
    counts = ("rows", "rows_train", "rows_test", "sequences")
    return {
        "schema": first["schema"],
        "model": model,
        "parameters": _mean_parameters([d for d in each if d["model"] == model]),
        **whole,
        "candidates": candidates,
        "purpose": first["purpose"],
        "baselines": _mean_baselines(each),
        "data": first["data"] | {k: sum(d["data"][k] for d in each) for k in counts},
        "seed": first["seed"],
        "seconds": sum(d["seconds"] for d in each),
        "versions": first["versions"],
        "failed": failed,
        "each": documents,
    }


def _in_common(documents: dict[str, dict[str, Any]]) -> dict[str, Any]:
    """Mean figures and gravest verdict of fits or of candidates."""
    each = list(documents.values())
    return {
        "metrics": _mean([d["metrics"] for d in each]),
        "score_percent": _mean([d["score_percent"] for d in each]),
        "success": all(d["success"] for d in each),
        "trusted": all(d["trusted"] for d in each),
        "verdict": {
            "level": worst_of(d["verdict"]["level"] for d in each),
            "reasons": [
                said | {"text": f"{value}: {said['text']}"}
                for value, d in documents.items()
                for said in d["verdict"]["reasons"][:1]
            ],
            "best_baseline": None,
        },
    }


def _mean_parameters(documents: list[dict[str, Any]]) -> list[dict[str, Any]]:
    status = {"stderr": None, "status": f"mean of {len(documents)}"}
    names = {tuple(p["name"] for p in d["parameters"]) for d in documents}
    if len(names) > 1:  # branches with other relaxation times have no mean
        return []
    columns = zip(*(d["parameters"] for d in documents), strict=True)
    return [each[0] | {"value": _mean([p["value"] for p in each])} | status for each in columns]


def _mean_baselines(documents: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Mean figures of those baselines that every fit has."""
    listed = [{one["name"]: one for one in d["baselines"]} for d in documents]
    shared = [name for name in listed[0] if all(name in found for found in listed)]
    keys = ("nrmse_percent", "rmse", "score_percent")
    return [
        {"name": name} | _mean([{key: found[name][key] for key in keys} for found in listed])
        for name in shared
    ]


def _mean(values: list[Any]) -> Any:
    """Of the numbers that are known, of objects entry by entry; None where there are none."""
    known = [v for v in values if v is not None]
    if known and isinstance(known[0], dict):
        return {key: _mean([one[key] for one in known]) for key in known[0]}
    return float(np.mean(known)) if known else None
