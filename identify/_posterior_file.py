"""A posterior beside its fit: a summary to read, draws for any tool that reads netCDF."""

from functools import partial
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from hysteresis import InputError

from ._posterior import Posterior, Summary
from ._save import describe_model, read_json, rebuild_model, write_json


def posterior_json(posterior: Posterior) -> dict[str, Any]:
    """The summary: parameters with mean, sd, quantiles, R-hat and effective draws."""
    ensembles, draws, _ = posterior.draws.shape
    return {
        "parameters": [s._asdict() for s in posterior.summaries],
        "draws": ensembles * draws,
        "seconds": round(posterior.seconds, 3),
        "method": posterior.method,
        "acceptance": posterior.acceptance,
        "autocorrelation": posterior.autocorrelation,
        "converged": posterior.converged,
    }


def save_posterior(posterior: Posterior, folder: str | Path) -> Path:
    """Write posterior.json, posterior.nc (ArviZ's groups and dimensions) and the models' arrays."""
    import h5netcdf

    folder = Path(folder)
    structure, arrays = describe_model(posterior.model)
    np.savez_compressed(folder / "posterior_models.npz", allow_pickle=False, **arrays)
    ensembles, draws, _ = posterior.draws.shape
    with h5netcdf.File(folder / "posterior.nc", "w") as file:
        group = file.create_group("posterior")
        group.dimensions = {"chain": ensembles, "draw": draws}
        for name, size in (("chain", ensembles), ("draw", draws)):
            group.create_variable(name, (name,), data=np.arange(size))
        for j, name in enumerate(posterior.names):
            group.create_variable(name, ("chain", "draw"), data=posterior.draws[..., j])
    document = posterior_json(posterior) | {"structure": structure, "names": list(posterior.names)}
    write_json(folder / "posterior.json", document)
    return folder / "posterior.nc"


def load_posterior(folder: str | Path) -> Posterior | None:
    """The posterior of a fit's folder, or None where it was not sampled.

    Raises `InputError` where its files are damaged.
    """
    import h5netcdf

    folder = Path(folder)
    if not (folder / "posterior.json").is_file():
        return None
    document = read_json(folder / "posterior.json")
    try:
        with h5netcdf.File(folder / "posterior.nc", "r") as file:
            group = file["posterior"]
            columns: list[Any] = [group[name][...] for name in document["names"]]
            draws = np.stack(columns, -1)
        with np.load(folder / "posterior_models.npz", allow_pickle=False) as arrays:
            # Under vmap each model has its own shapes; together their arrays keep the draw axis.
            rebuild = partial(rebuild_model, document["structure"])
            model = jax.vmap(rebuild)({name: jnp.asarray(a) for name, a in arrays.items()})
    except (OSError, KeyError, ValueError) as error:
        raise InputError(
            "damaged-file",
            f"the posterior cannot be read: {error}.",
            place=str(folder),
            fix="sample again: hysid sample DIR.",
        ) from error
    return Posterior(
        names=tuple(document["names"]),
        draws=draws,
        model=model,
        summaries=tuple(Summary(**s) for s in document["parameters"]),
        method=document["method"],
        acceptance=document["acceptance"],
        autocorrelation=np.nan if (tau := document["autocorrelation"]) is None else tau,
        seconds=document["seconds"],
    )
