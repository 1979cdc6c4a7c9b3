"""`hysid sample` and `hysid design`: what a fit leaves open, and the record that would tell it."""

from typing import Annotated

import typer

from ._console import (
    AsJson,
    Folder,
    Progress,
    Seed,
    log,
    print_result,
    start_jax,
    warnings,
)  # fmt: skip

SHOWN = 12
"""Multisines in the table of `hysid design`."""


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
            found = _sample.sample(folder, **chosen, resume=resume, progress=progress)
    except KeyboardInterrupt:
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


def design(
    folder: Folder,
    levels: Annotated[
        str | None,
        typer.Option(
            help="Rms forces, as 20,50 (default: a quarter to four times the fitted one)."
        ),
    ] = None,
    bands: Annotated[
        str | None,
        typer.Option(help="Bands of frequencies, as 5-150,20-80 (default: about the resonance)."),
    ] = None,
    max_displacement: Annotated[
        float | None, typer.Option(help="Largest displacement that the rig allows.")
    ] = None,
    rows: Annotated[
        int | None, typer.Option(help="Rows of a period (default: those of the fitted record).")
    ] = None,
    seed: Seed = 0,
    as_json: AsJson = False,
) -> None:
    """Find the multisine that would tell the hysteresis of a fitted oscillator best.

    Each candidate's standard errors are those that one period in steady state would leave, relative to
    the values. DIR/excitation.csv has one period of the best one within the fitted displacements.
    """
    start_jax()
    from ..operations import _design  # after JAX is set up

    found = _design.design(
        folder, levels=levels, bands=bands, largest=max_displacement, rows=rows, seed=seed
    )
    units = found["units"]
    of_level, of_place = f"rms ({units['level']})", f"largest ({units['displacement']})"
    lines = [
        f"{'band (' + units['frequency'] + ')':>22}{of_level:>12}{'hysteresis':>12}{'mass':>10}"
        f"{'damping':>10}{'stiffness':>11}{of_place:>14}"
    ]
    lines += [
        f"{one['low']:>11.4g}{one['high']:>11.4g}{one['level']:>12.4g}{one['hysteresis']:>12.2%}"
        f"{one['mass']:>10.2%}{one['damping']:>10.2%}{one['stiffness']:>11.2%}"
        f"{one['displacement']:>14.3g}{'  beyond the fitted record' if one['beyond'] else ''}"
        for one in found["multisines"][:SHOWN]
    ]
    if found["extrapolated"]:
        lines += warnings(
            ["Every multisine moves farther than the fitted record, so these figures extrapolate."]
        )
    print_result(found, as_json, [*lines, found["file"]])
