"""A posterior beside its fit: a summary to read, draws for any tool that reads netCDF."""

import hashlib
from functools import partial
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from hysteresis import InputError
from hysteresis._limits import damage_told, load_arrays
from hysteresis._serialisation import described, rebuilt
from hysteresis.records.importers._matlab import opened_hdf5

from ..posterior._posterior import Posterior, Summary
from ..storage._file_set import check_unedited, read_json, whole_files, write_set

Groups = dict[str, dict[str, tuple[tuple[str, ...], np.ndarray]]]


def posterior_json(posterior: Posterior) -> dict[str, Any]:
    """The summary: parameters with mean, sd, quantiles, R-hat, effective draws and what to mind."""
    ensembles, draws, _ = posterior.draws.shape
    same = ("method", "acceptance", "autocorrelation", "converged", "long_enough")
    return {
        "parameters": [s._asdict() | {"words": list(s.words)} for s in posterior.summaries],
        "draws": ensembles * draws,
        "seconds": round(posterior.seconds, 3),
        **{name: getattr(posterior, name) for name in same},
        "notes": list(posterior.notes),
    }


def save_posterior(posterior: Posterior, folder: str | Path) -> Path:
    """Write posterior.json, posterior.nc (ArviZ's groups and dimensions) and the models' arrays.

    The groups are `posterior` and, if it was sampled by Markov chains, `sample_stats` (lp,
    acceptance_rate, ...), `prior`, and for the rows of the fit `log_likelihood`, `posterior_predictive` and
    `observed_data`.

    **Arguments:** `folder`: the folder of the fit, which must exist.

    Returns the path of posterior.nc.

    **Example:**

        >>> identify.save_posterior(posterior, folder).name
        'posterior.nc'
    """
    folder = Path(folder)
    structure, arrays = described(posterior.model)
    document = posterior_json(posterior) | {
        "structure": structure, "names": list(posterior.names), "fit": _fit_in(folder),
    }  # fmt: skip
    files: dict[str, Any] = {
        "posterior.nc": partial(_write_netcdf, posterior),
        "posterior_models.npz": arrays,
    }
    write_set(folder, "posterior.json", document, files)
    return folder / "posterior.nc"


def _fit_in(folder: Path) -> str | None:
    """The checksum of the fit that the folder holds."""
    file = folder / "fit.json"
    return hashlib.sha256(file.read_bytes()).hexdigest() if file.is_file() else None


def _write_netcdf(posterior: Posterior, place: Path) -> None:
    import h5netcdf

    with h5netcdf.File(place, "w") as file:
        for name, variables in _groups(posterior).items():
            group = file.create_group(name)
            sizes = {
                d: n for dims, a in variables.values() for d, n in zip(dims, a.shape, strict=True)
            }
            group.dimensions = sizes
            for dimension, size in sizes.items():
                if dimension not in variables:
                    group.create_variable(dimension, (dimension,), data=np.arange(size))
            for variable, (dims, array) in variables.items():
                packed = {"compression": "gzip"} if array.ndim == 3 else {}
                group.create_variable(variable, dims, data=array, **packed)


def _groups(posterior: Posterior) -> Groups:
    """{group: {variable: (dimensions, values)}}."""
    by_draw, by_row = ("chain", "draw"), ("chain", "draw", "row")
    found: Groups = {"posterior": _named(posterior, posterior.draws)}
    if posterior.log_probability is not None:
        statistics = {"lp": (by_draw, posterior.log_probability)}
        for name, array in posterior.statistics.items():
            whole = np.broadcast_to(array.reshape(len(array), -1), posterior.draws.shape[:2])
            statistics[name] = (by_draw, whole)
        found["sample_stats"] = statistics
    if posterior.prior is not None:
        found["prior"] = _named(posterior, posterior.prior[None])
    if (rows := posterior.per_row) is not None:
        row = {"row": (("row",), rows.rows)}
        found["log_likelihood"] = {"output": (by_row, rows.log_likelihood), **row}
        found["posterior_predictive"] = {"output": (by_row, rows.predictive), **row}
        found["observed_data"] = {"output": (("row",), rows.observed), **row}
    return found


def _named(
    posterior: Posterior, draws: np.ndarray
) -> dict[str, tuple[tuple[str, ...], np.ndarray]]:
    return {name: (("chain", "draw"), draws[..., j]) for j, name in enumerate(posterior.names)}


def load_posterior(folder: str | Path) -> Posterior | None:
    """The posterior in the folder of a fit, or None if it was not sampled.

    Raises `InputError` `damaged-file` if its files cannot be read.

    **Example:**

        >>> place = identify.save_posterior(posterior, folder)
        >>> identify.load_posterior(folder).names
        ('K', 'b', 'sigma')
    """
    # netCDF is HDF5. Of a damaged file h5netcdf leaves an object whose end prints a traceback.
    folder = Path(folder)
    if not (folder / "posterior.json").is_file():
        return None
    document = read_json(folder / "posterior.json")
    check_unedited(folder, "posterior.json", document)
    names = ("posterior.nc", "posterior_models.npz")
    # Earlier versions wrote neither the checksums of the files nor that of the fit.
    places = {name: folder / name for name in names} | whole_files(
        folder, {"files": {}} | document, "sample again: hysid sample DIR."
    )
    if document.get("fit") not in (None, _fit_in(folder)):
        raise InputError(
            "other-checkpoint",
            "the posterior was sampled for another fit than the one in this folder.",
            place=str(folder),
            cause="the fit was made again.",
            fix="sample again: hysid sample DIR.",
        )
    with damage_told("the posterior", folder, "sample again: hysid sample DIR."):
        with opened_hdf5(places["posterior.nc"].read_bytes()) as file:
            draws = np.stack([file.array(f"posterior/{name}") for name in document["names"]], -1)
        arrays = load_arrays(places["posterior_models.npz"])
        # Under vmap each model has its own shapes; together their arrays keep the draw axis.
        rebuild = partial(rebuilt, document["structure"])
        model = jax.vmap(rebuild)({name: jnp.asarray(a) for name, a in arrays.items()})
        kept = [{k: s[k] for k in Summary._fields if k in s} for s in document["parameters"]]
        return Posterior(
            **{name: document[name] for name in ("method", "acceptance", "seconds")},
            names=tuple(document["names"]),
            draws=draws,
            model=model,
            summaries=tuple(Summary(**one) for one in kept),
            autocorrelation=np.nan if (tau := document["autocorrelation"]) is None else tau,
            notes=tuple(document.get("notes", ())),
            long_enough=document.get("long_enough", True),
        )
