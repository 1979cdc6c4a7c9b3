"""A studio that serves in a thread of the test, and who asks it."""

import json
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from http.client import HTTPConnection
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import urlsplit

from hysid.studio._server import Prepared, prepared
from hysteresis import model_names

MODELS = (*model_names(), "Preisach", "Composition", "EverettSurface", "Butterfly", "Oscillator")


@contextmanager
def serving(files: Sequence[Path], said: Callable[[str], None] | None = None) -> Iterator[Prepared]:
    """The studio of these files, until the block ends."""
    ready = prepared(files, 0, MODELS, said)
    thread = threading.Thread(target=ready.run)
    thread.start()
    try:
        yield ready
    finally:
        ready.server.should_exit = True
        thread.join(20)
    assert not thread.is_alive()


@contextmanager
def studio_of(*files: Path) -> Iterator[Any]:
    """The studio of these files, which answers nobody."""
    ready = prepared(files, 0, MODELS)
    try:
        yield ready.studio
    finally:
        ready.studio.jobs.close()
        ready.listening.close()


@contextmanager
def entering(folder: Path) -> Iterator[tuple[Prepared, Callable[..., "Answer"]]]:
    """A studio of a folder, and how somebody in a session asks it."""
    with serving([folder]) as ready:
        yield ready, partial(ask, ready.address, X_Hysid=entered(ready.address))


class Answer(NamedTuple):
    """What the studio answers."""

    status: int
    body: bytes
    headers: dict[str, str]

    @property
    def document(self) -> Any:
        """The body as JSON."""
        return json.loads(self.body)


def ask(address: str, path: str, body: Any = None, method: str = "", **headers: str) -> Answer:
    """The answer of the server at an address: GET, or POST of a body as JSON."""
    connection = HTTPConnection(urlsplit(address).netloc, timeout=30)
    try:
        given = None if body is None else json.dumps(body)
        named = {name.replace("_", "-"): value for name, value in headers.items()}
        connection.request(method or ("GET" if body is None else "POST"), path, given, named)
        answer = connection.getresponse()
        found = {name.lower(): value for name, value in answer.getheaders()}
        return Answer(answer.status, answer.read(), found)
    finally:
        connection.close()


def entered(address: str) -> str:
    """The secret of the session that an address opens."""
    token = urlsplit(address).query.removeprefix("token=")
    return ask(address, "/api/enter", {"token": token}).document["session"]
