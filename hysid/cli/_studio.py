"""`hysid studio`."""

import importlib.util
import json
from pathlib import Path
from typing import Annotated

import typer

from ..commands._console import AsJson, start_jax
from ..intake._fit_options import MODELS

EXTRA = ("starlette", "uvicorn", "tomlkit")


def studio(
    files: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="[FILE...]",
            help="Files of one folder, or a folder (default: the current one).",
        ),
    ] = None,
    port: Annotated[
        int, typer.Option(min=0, max=65535, help="Port of the page; 0 for any that is free.")
    ] = 0,
    browser: Annotated[
        bool, typer.Option("--browser/--no-browser", help="Open the page in a browser.")
    ] = True,
    as_json: AsJson = False,
) -> None:
    """Show a page in the browser to look at measurements, fit them and export compensators.

    The page is on this machine alone, and its address opens it once; opening it again prints another. It
    works on one folder, on the same files as the other commands; nothing is uploaded anywhere.
    """
    if missing := [name for name in EXTRA if importlib.util.find_spec(name) is None]:
        from hysteresis import InputError  # late: it loads JAX

        raise InputError(
            "missing-extra",
            f"{missing[0]} is not installed.",
            fix="Install it with pip install 'hysid[studio]'.",
        )
    start_jax()
    from ..studio._server import serve  # after JAX is set up

    def said(address: str) -> None:
        text = json.dumps({"address": address}) if as_json else f"hysid studio: {address}"
        print(text, flush=True)

    serve(files or [], port, MODELS, browser, said)
