"""Files that belong together change at once: whatever stops a writer, one whole set is there."""

import os
import signal
import threading
from pathlib import Path

import pytest

from identify.internal import read_json, whole_files, write_set
from identify.storage import _file_set
from identify.storage._file_set import check_unedited

NAMES = ("model.npz", "data.npz", "fit.npz")


def written(folder: Path, word: str) -> None:
    files = {name: lambda place: place.write_text(word) and None for name in NAMES}
    write_set(folder, "fit.json", {"word": word}, files, remove=["report.html"])


def read(folder: Path) -> tuple[str, set[str]]:
    """The word of the document, and the words of the files that belong to it."""
    document = read_json(folder / "fit.json")
    check_unedited(folder, "fit.json", document)
    return document["word"], {p.read_text() for p in whole_files(folder, document).values()}


class Killed(BaseException):
    """As if the process ended here."""


def mortal_from(moment: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every change of a folder from this one on ends the process."""
    calls = iter(range(100))

    def mortal(function):
        def called(*arguments, **named):
            if next(calls) >= moment:
                raise Killed
            return function(*arguments, **named)

        return called

    for owner, name in (
        (os, "replace"),
        (Path, "unlink"),
        (Path, "write_text"),
        (Path, "write_bytes"),
    ):
        monkeypatch.setattr(owner, name, mortal(getattr(owner, name)))


@pytest.mark.parametrize("moment", range(12))
def test_a_process_killed_at_any_moment_leaves_a_whole_set(moment: int, tmp_path, monkeypatch):
    """Before each of its changes of the folder in turn: nothing of ours runs after that."""
    written(tmp_path, "old")
    (tmp_path / "report.html").write_text("old")
    mortal_from(moment, monkeypatch)
    ended = False
    try:
        written(tmp_path, "new")
        ended = True
    except Killed:
        pass
    monkeypatch.undo()
    word, held = read(tmp_path)
    assert held == {word}
    assert word == "new" or not ended
    if ended:
        assert sorted(p.name for p in tmp_path.iterdir()) == sorted([*NAMES, "fit.json"])
    written(tmp_path, "last")
    assert read(tmp_path) == ("last", {"last"})


def test_a_full_disk_leaves_the_old_set(tmp_path: Path):
    written(tmp_path, "old")
    before = sorted(p.name for p in tmp_path.iterdir())

    def full(place: Path) -> None:
        place.write_text("half")
        raise OSError(28, "No space left on device")

    with pytest.raises(OSError, match="No space"):
        write_set(tmp_path, "fit.json", {}, {"model.npz": full})
    assert sorted(p.name for p in tmp_path.iterdir()) == before
    assert read(tmp_path) == ("old", {"old"})


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_waits_for_the_end(number: int, tmp_path: Path):
    """Ctrl-C or SIGTERM while a file is written: the set is complete, then the interrupt comes."""
    before = signal.signal(number, signal.default_int_handler)

    def pressed(place: Path) -> None:
        signal.raise_signal(number)
        place.write_text("new")

    with pytest.raises(KeyboardInterrupt):
        write_set(tmp_path, "fit.json", {"word": "new"}, {"model.npz": pressed})
    assert signal.signal(number, before) is signal.default_int_handler
    assert read(tmp_path) == ("new", {"new"})


def test_two_writers_take_turns(tmp_path: Path):
    """The second one waits; what it is asked to check is asked when the first is done."""
    pytest.importorskip("fcntl")
    seen: list[bool] = []
    check = lambda: seen.append((tmp_path / "first").exists())  # noqa: E731
    more = {"args": (tmp_path, "fit.json", {}, {}), "kwargs": {"check": check}}
    second = threading.Thread(target=write_set, **more)
    with _file_set._alone(tmp_path):
        second.start()
        second.join(0.2)
        assert second.is_alive()
        assert seen == []
        (tmp_path / "first").touch()
    second.join()
    assert seen == [True]
