"""`hysid studio`."""

import importlib.util
import json

from hysteresis import InputError

from ..commands._asked_more import Studio
from ..commands._console import start_jax
from ..intake._fit_options import MODELS

EXTRA = ("starlette", "uvicorn", "tomlkit")


def run(asked: Studio) -> None:
    """Serve the page until it is interrupted."""
    if missing := [name for name in EXTRA if importlib.util.find_spec(name) is None]:
        raise InputError(
            "missing-extra",
            f"{missing[0]} is not installed.",
            fix="Install it with pip install 'hysid[studio]'.",
        )
    start_jax()
    from ._server import serve  # after JAX is set up

    def said(address: str) -> None:
        text = json.dumps({"address": address}) if asked.as_json else f"hysid studio: {address}"
        print(text, flush=True)

    serve(asked.files or [], asked.port, MODELS, asked.browser, said)
