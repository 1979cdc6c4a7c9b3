"""A studio that serves in a thread of the test."""

import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from hysid.cli._fit import MODELS
from hysid.studio._server import Prepared, prepared


@contextmanager
def serving(files: Sequence[Path]) -> Iterator[Prepared]:
    """The studio of these files, until the block ends."""
    ready = prepared(files, 0, MODELS)
    thread = threading.Thread(target=ready.run)
    thread.start()
    try:
        yield ready
    finally:
        ready.server.should_exit = True
        thread.join(20)
    assert not thread.is_alive()
