"""A file as it is written, and the table that is read from it."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from hysteresis import read_table


@pytest.fixture
def table(tmp_path: Path) -> Callable[..., Any]:
    def read(content: str | bytes, name: str = "run.txt", **options: Any) -> Any:
        file = tmp_path / name
        file.write_bytes(content if isinstance(content, bytes) else content.encode())
        return read_table(file, **options)

    return read
