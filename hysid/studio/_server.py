"""`hysid studio`: the server of one folder, on this machine's own address alone."""

import html
import os
import socket
import tempfile
import threading
import time
import webbrowser
from asyncio import Transport
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import quote

import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol

from hysteresis import InputError
from hysteresis.records._units import is_unit

from ._app import Studio, app_of
from ._folder import Folder
from ._requests import PATIENCE, Guard, Sessions

ADDRESS = "127.0.0.1"
SOON = 2
"""Seconds in which open connections may end, when the studio does."""
MOST = 100
"""Connections; a page has six. Beyond, requests are answered with status 503."""


class _Connection(H11Protocol):
    """A connection that ends where no request begins within `PATIENCE` seconds of the last answer."""

    def connection_made(self, transport: Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        self.loop.call_later(PATIENCE, self._end, None)

    def on_response_complete(self) -> None:
        super().on_response_complete()
        self.loop.call_later(PATIENCE, self._end, self.cycle)

    def _end(self, cycle: Any) -> None:
        if self.cycle is cycle:
            self.transport.close()


class Prepared(NamedTuple):
    """A server that listens, the address of its page, its studio, and who may ask it."""

    server: uvicorn.Server
    listening: socket.socket
    address: str
    studio: Studio
    sessions: Sessions

    def run(self) -> None:
        """Serve until interrupted, or until `server.should_exit`; then end every command that runs."""
        # The table of units takes half a second to load, which the first file need not wait for.
        threading.Thread(target=is_unit, args=("furlong",), daemon=True).start()
        try:
            self.server.run(sockets=[self.listening])
        finally:
            self.studio.jobs.close()
            self.listening.close()


def prepared(
    files: Sequence[Path],
    port: int,
    models: Sequence[str],
    said: Callable[[str], None] | None = None,
) -> Prepared:
    """A server of the folder of these files, or of the current one; a folder may stand for its files.

    `models`: names of models that the page offers. `said` gets each address, which opens the page once.
    Raises `InputError` `outside-folder` where the files are in several folders, `file-not-found`, and
    `bad-option` for a port in use.
    """
    folder = _folder_of(files)
    listening = _listening(port)
    port = listening.getsockname()[1]
    studio, host = Studio(folder, models), f"{ADDRESS}:{port}"
    named = [path.resolve().relative_to(folder.root) for path in files if path.is_file()]
    first = f"#{quote(named[0].as_posix(), errors='replace')}" if named else ""
    addresses: list[str] = []

    def new(token: str) -> None:
        addresses.append(f"http://{host}/?token={token}{first}")
        if said is not None:
            said(addresses[-1])

    sessions = Sessions(new)
    config = uvicorn.Config(
        Guard(app_of(studio, sessions), sessions, host), log_level="error", access_log=False,
        timeout_graceful_shutdown=SOON, server_header=False, lifespan="off", proxy_headers=False,
        limit_concurrency=MOST, http=_Connection, ws="none",
    )  # fmt: skip
    return Prepared(uvicorn.Server(config), listening, addresses[0], studio, sessions)


def open_page(ready: Prepared) -> None:
    """Open the page in the user's browser, by a file that leads there and is removed when it has been used.

    Everybody on this machine sees what a browser is started with; the file, with the token, only its user
    can read. It is in the home folder, because a browser in a sandbox has a /tmp of its own.
    """
    home = Path.home()
    place = home if os.access(home, os.W_OK) else None
    with tempfile.TemporaryDirectory(prefix="hysid-studio-", dir=place) as folder:
        file = Path(folder, "open.html")
        file.touch(0o600)
        goal = html.escape(ready.address)
        file.write_text(
            f'<!DOCTYPE html><meta http-equiv="refresh" content="0; url={goal}">', "utf-8"
        )
        there = webbrowser.open(file.as_uri())
        while there and ready.sessions.waiting and not ready.server.should_exit:
            time.sleep(0.1)


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
    try:  # a browser may come before the server has started
        return socket.create_server((ADDRESS, port), backlog=128)
    except OSError:
        raise InputError(
            "bad-option", f"Another program uses port {port}.", place=f"--port {port}",
            fix="Choose another one, or --port 0 for any that is free.",
        ) from None  # fmt: skip
