"""An empty folder as the current one, for commands that name files in it."""

import pytest


@pytest.fixture
def empty_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
