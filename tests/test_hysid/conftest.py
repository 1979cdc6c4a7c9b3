"""Empty folders, and pictures of little density wherever a command or a report draws some."""

import pytest

from tests.test_hysid.command import coarse_pictures


@pytest.fixture(scope="module", autouse=True)
def _nobody_looks_at_the_pictures():
    with coarse_pictures():
        yield


@pytest.fixture
def empty_folder(tmp_path, monkeypatch):
    """The current one, for commands that name files in it."""
    monkeypatch.chdir(tmp_path)
