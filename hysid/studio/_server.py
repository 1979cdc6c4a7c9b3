"""`hysid studio`: the server of one folder, on this machine's own address alone."""

import socket
import threading
import webbrowser
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple
from urllib.parse import quote

import uvicorn

from hysteresis import InputError
from hysteresis.records._units import is_unit

from ._app import Studio, app_of
from ._folder import Folder
from ._guard import Guard, new_token

ADDRESS = "127.0.0.1"
SOON = 2
"""Seconds in which open connections may end, when the studio does."""


class Prepared(NamedTuple):
    """A server that listens, the address of its page, and its studio; `close` it."""

    server: uvicorn.Server
    listening: socket.socket
    address: str
    studio: Studio

    def run(self) -> None:
        """Serve until interrupted, or until `server.should_exit`; then end every command that runs."""
        # The table of units takes half a second to load, which the first file need not wait for.
        threading.Thread(target=is_unit, args=("furlong",), daemon=True).start()
        try:
            self.server.run(sockets=[self.listening])
        finally:
            self.studio.jobs.close()
            self.listening.close()


def prepared(files: Sequence[Path], port: int, models: Sequence[str]) -> Prepared:
    """A server of the folder of these files, or of the current one; a folder may stand for its files.

    `models`: names of models that the page offers. Raises `InputError` `outside-folder` where the files are
    in several folders, `file-not-found`, and `bad-option` for a port in use.
    """
    folder = _folder_of(files)
    listening = _listening(port)
    port = listening.getsockname()[1]
    token, studio = new_token(), Studio(folder, models)
    named = [path.resolve().relative_to(folder.root) for path in files if path.is_file()]
    first = f"#{quote(named[0].as_posix())}" if named else ""
    config = uvicorn.Config(
        Guard(app_of(studio), token, port), log_level="warning", access_log=False,
        timeout_graceful_shutdown=SOON, server_header=False, lifespan="off",
    )  # fmt: skip
    address = f"http://{ADDRESS}:{port}/?token={token}{first}"
    return Prepared(uvicorn.Server(config), listening, address, studio)


def serve(
    files: Sequence[Path],
    port: int,
    models: Sequence[str],
    browser: bool,
    said: Callable[[str], None],
) -> None:
    """Serve as `prepared` until interrupted; `said` gets the address."""
    ready = prepared(files, port, models)
    said(ready.address)
    if browser:
        threading.Timer(0.5, webbrowser.open, (ready.address,)).start()
    ready.run()


def _folder_of(files: Sequence[Path]) -> Folder:
    if len(files) == 1 and files[0].is_dir():
        return Folder(files[0])
    for file in files:
        if not file.is_file():
            raise InputError(
                "file-not-found", "There is no such file.", place=str(file),
                fix="Check the name, or start hysid studio without one and drop the file on the page.",
            )  # fmt: skip
    folders = {file.resolve().parent for file in files} or {Path.cwd()}
    if len(folders) > 1:
        raise InputError(
            "outside-folder",
            f"These files are in {len(folders)} folders, and a studio works in one.",
            fix="Copy them into one folder, or start one studio for each.",
        )
    return Folder(folders.pop(), files)


def _listening(port: int) -> socket.socket:
    found = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    try:
        found.bind((ADDRESS, port))
    except OSError:
        found.close()
        raise InputError(
            "bad-option", f"Another program uses port {port}.", place=f"--port {port}",
            fix="Choose another one, or --port 0 for any that is free.",
        ) from None  # fmt: skip
    found.listen(128)  # a browser may come before the server has started
    return found
