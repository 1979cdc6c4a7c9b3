"""`hysid studio`."""

import json
import os
import threading

from .._packages import check_extra
from ..commands._asked_more import Studio
from ..commands._console import start_jax
from ..intake._options import MODELS


def run(asked: Studio) -> None:
    """Serve the page until it is interrupted."""
    check_extra("studio", "starlette", "uvicorn", "tomlkit")
    start_jax()
    from ._server import open_page, prepared  # after JAX is set up

    def said(address: str) -> None:
        text = json.dumps({"address": address}) if asked.as_json else f"hysid studio: {address}"
        print(text, flush=True)

    ready = prepared(asked.files or [], asked.port, MODELS, said)
    os.chdir(ready.studio.folder.root)  # as the commands it starts, for names in a configuration
    if asked.browser:
        threading.Timer(0.5, open_page, (ready,)).start()
    ready.run()
