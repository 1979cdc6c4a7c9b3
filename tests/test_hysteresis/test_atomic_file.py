"""A file is the old one or the new one, whole."""

import os

import pytest

from hysteresis._atomic_file import atomic_file


@pytest.fixture
def file(tmp_path):
    (tmp_path / "fit.json").write_text("old")
    return tmp_path / "fit.json"


@pytest.mark.parametrize("durable", [False, True])
def test_the_new_file_replaces_the_old_one(file, durable):
    with atomic_file(file, durable=durable) as new:
        new.write_text("new")
        assert file.read_text() == "old"
    assert file.read_text() == "new"
    assert os.listdir(file.parent) == ["fit.json"]


def test_what_raises_leaves_the_old_file_alone(file):
    def interrupted():
        with atomic_file(file) as new:
            new.write_text("half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert file.read_text() == "old"
    assert os.listdir(file.parent) == ["fit.json"]
