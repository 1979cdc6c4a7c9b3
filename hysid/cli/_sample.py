"""`hysid sample`."""

from typing import Annotated

import typer

from ._console import (
    AsJson,
    Folder,
    Progress,
    Seed,
    log,
    one_of,
    print_result,
    start_jax,
    warnings,
)  # fmt: skip


def sample(
    folder: Folder,
    steps: Annotated[
        int | None,
        typer.Option(
            help="Total MCMC steps per ensemble (default: run until R-hat < 1.01).",
        ),
    ] = None,
    ensembles: Annotated[int, typer.Option(help="Independent ensembles.")] = 4,
    walkers: Annotated[
        int | None,
        typer.Option(help="Walkers per ensemble (default: from the number of parameters)."),
    ] = None,
    method: Annotated[
        str,
        typer.Option(
            callback=one_of("emcee", "nuts"), help="Sampler: emcee, or nuts (needs hysid[nuts])."
        ),
    ] = "emcee",
    resume: Annotated[bool, typer.Option("--resume", help="Resume from the saved chains.")] = False,
    seed: Seed = 0,
    as_json: AsJson = False,
) -> None:
    """Sample the posterior of a fit's parameters."""
    start_jax()
    from ..operations import _sample  # after JAX is set up

    chosen = {"steps": steps, "walkers": walkers, "ensembles": ensembles, "seed": seed}
    try:
        with Progress("sampling") as progress:
            found = _sample.sample(
                folder, **chosen, method=method, resume=resume, progress=progress
            )
    except KeyboardInterrupt:
        if method == "emcee":
            from hysteresis._escape import shell_word  # JAX is loaded now

            given = [f"--{name} {value}" for name, value in chosen.items() if value is not None]
            log(f"To resume: hysid sample {shell_word(str(folder))} --resume {' '.join(given)}")
        raise
    lines = [f"{'parameter':24}{'mean':>12}{'sd':>12}{'5 %':>12}{'95 %':>12}{'R-hat':>8}{'ESS':>8}"]
    lines += [
        f"{p['name']:24}{p['mean']:12.4g}{p['sd']:12.3g}{p['q05']:12.4g}{p['q95']:12.4g}"
        f"{p['rhat']:8.3f}{p['ess']:8.0f}{''.join(f'  {words}' for words in p['words'])}"
        for p in found["parameters"]
    ]
    lines += warnings(found["notes"])
    if not found["converged"]:
        lines.append(
            "Not converged: R-hat is above 1.01, or there are too few draws. Run again without"
            " --steps, or with more of them."
        )
    print_result(found, as_json, lines)
