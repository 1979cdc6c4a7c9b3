"""Files that belong together: a JSON document and the files it names, replaced all at once."""

import contextlib
import hashlib
import json
import os
import platform
import signal
import threading
import zipfile
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from hysteresis import InputError
from hysteresis._escape import json_text
from hysteresis._files import atomic_file, naming
from hysteresis._format import plain
from hysteresis._limits import parse_json

# JSON documents, written whole and read with an error that says what is wrong.

# Which versions of which software made a result.


FIT = ("hysid", "jax", "equinox", "optimistix", "emcee", "numpy")
"""Packages that a fit depends on."""


def versions(packages: Iterable[str] = FIT) -> dict[str, str]:
    """The versions of Python and of `packages`; "not installed" for one that is missing."""
    return {"python": platform.python_version()} | {name: _version(name) for name in packages}


@cache
def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"


def write_json(file: Path, document: dict[str, Any]) -> None:
    """Write a JSON document, whole or not at all."""
    text = json_text(json.dumps(plain(document), indent=2, ensure_ascii=False)) + "\n"
    with atomic_file(file) as new:
        new.write_text(text, "utf-8")


def read_json(file: Path) -> dict[str, Any]:
    """A JSON object from a file.

    Raises `InputError` `damaged-file` if it cannot be read, or is not a JSON object.
    """
    try:
        document = parse_json(file.read_bytes())
    except (ValueError, OSError) as error:
        document = error
    if not isinstance(document, dict):
        raise InputError(
            "damaged-file",
            f"{file.name} cannot be read: {document}.",
            place=str(file.parent),
            cause="it was cut off, or is not ours.",
            fix="make it again.",
        )
    return document


def check_free(
    folder: str | Path,
    overwrite: bool,
    name: str = "fit.json",
    instead: str = "name another folder (--out DIR)",
) -> None:
    """Raise `InputError` if `folder` holds the results `name` and these may not be overwritten; what can be
    done `instead`."""
    folder = Path(folder)
    if folder.exists() and not folder.is_dir():
        raise InputError("not-a-folder", f"{folder} is a file.", fix="name another folder (--out).")
    if (folder / name).exists() and not overwrite:
        raise InputError(
            "would-overwrite",
            "results are there already, and were left as they are.",
            place=str(folder),
            fix=f"{instead}, or write over them (--overwrite).",
        )


Content = Callable[[Path], None] | Mapping[str, Any] | bytes
"""Of a file: what writes it, the arrays of an .npz, or its bytes."""


def write_set(
    folder: Path,
    name: str,
    document: Mapping[str, Any],
    files: Mapping[str, Content],
    *,
    remove: Collection[str] = (),
    check: Callable[[], None] = lambda: None,
) -> dict[str, Any]:
    """Write `files` {name: content} and the document that holds their checksums; all or none.

    The files are written beside the old ones. Then one rename puts the new document in the place of the old
    one: before it the old set is whole, after it the new one is, because `whole_files` finds a file under
    either name. Last the files get their names. So a process that is killed, or a disk that is full, loses
    nothing. Of two writers, the second waits for the first.

    **Arguments:**

    - `remove`: files of the old set that the new one makes wrong.
    - `check`: is called when no other writer is at work, and may refuse.

    Returns the document as it was written, with `files` and `checksums`.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with _alone(folder), _uninterrupted():
        check()
        document = _written(folder, name, document, files)
        for old in remove:
            (folder / old).unlink(missing_ok=True)
        for one in files:
            os.replace(_aside(folder, one), folder / one)
    return document


def _written(
    folder: Path, name: str, document: Mapping[str, Any], files: Mapping[str, Content]
) -> dict[str, Any]:
    """The files beside the old ones, then the document with their checksums; nothing where that fails."""
    aside = {one: _aside(folder, one) for one in files}
    try:
        for one, content in files.items():
            with naming(folder / one, aside[one]):
                _put(aside[one], content)
        digests = {one: _digest(place) for one, place in aside.items()}
        found = sealed({**document, "files": digests})
        write_json(folder / name, found)
    except BaseException:
        for place in aside.values():
            place.unlink(missing_ok=True)
        raise
    return found


def _put(file: Path, content: Content) -> None:
    if isinstance(content, bytes):
        file.write_bytes(content)
    elif not isinstance(content, Mapping):
        content(file)
    else:
        # As np.savez_compressed, in half the time: noise hardly gets smaller by more work.
        with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as packed:
            for name, array in content.items():
                with packed.open(f"{name}.npy", "w", force_zip64=True) as member:
                    np.lib.format.write_array(member, np.asanyarray(array), allow_pickle=False)


def read_checked(folder: Path, name: str, schema: int, *, make: str, again: str) -> dict[str, Any]:
    """The document of a set as it was written.

    Raises `InputError` where it is missing (`make` it), damaged, edited, or of another schema (`again`).
    """
    if not (folder / name).is_file():
        raise InputError("file-not-found", f"there is no {name}.", place=str(folder), fix=make)
    document = read_json(folder / name)
    if (found := document.get("schema")) != schema:
        said = f"{name} has schema {found}, and this version reads {schema}."
        fix = f"update hysid, or {again}"
        raise InputError("newer-schema", said, place=str(folder), fix=fix)
    check_unedited(folder, name, document)
    return document


def whole_files(
    folder: Path, document: Mapping[str, Any], fix: str = "fit again, or copy the whole folder."
) -> dict[str, Path]:
    """Where the files are that a document names, by name: each is the one that was written with it.

    Raises `InputError` for a file that is missing, or another than was written.
    """
    found, listed = {}, document.get("files")
    if not isinstance(listed, dict):
        raise InputError(
            "damaged-file", "the list of its files cannot be read.", place=str(folder), fix=fix
        )
    for name, digest in listed.items():
        name = Path(name).name
        places = [p for p in (folder / name, _aside(folder, name)) if p.is_file()]
        if not places:
            raise InputError(
                "file-not-found",
                f"{name} is missing.",
                place=str(folder),
                fix=fix,
            )
        whole = [place for place in places if _digest(place) == digest]
        if not whole:
            raise InputError(
                "wrong-checksum",
                f"{name} is not the file that was saved.",
                place=str(folder),
                cause="it was cut off or edited.",
                fix=fix,
            )
        found[name] = whole[0]
    return found


def sealed(document: Mapping[str, Any]) -> dict[str, Any]:
    """A document with a checksum of each of its entries."""
    found = {key: value for key, value in plain(dict(document)).items() if key != "checksums"}
    return found | {"checksums": {key: _of_entry(value) for key, value in found.items()}}


def check_unedited(folder: Path, name: str, document: Mapping[str, Any]) -> None:
    """Raise `InputError` `edited-file` where a document is not the one that was written; none without
    checksums."""
    if (known := document.get("checksums")) is None:
        return
    known = known if isinstance(known, dict) else {}
    now = {key: value for key, value in document.items() if key != "checksums"}
    changed = [
        key for key in {**now, **known} if key not in now or _of_entry(now[key]) != known.get(key)
    ]
    if changed:
        raise InputError(
            "edited-file",
            f"{name} was changed since it was written: {', '.join(changed[:8])}.",
            place=str(folder),
            cause="it was edited, or files of two results were mixed.",
            fix=f'make it again. To use it as it is, remove the entry "checksums" from {name}.',
        )


def _of_entry(value: Any) -> str:
    text = json.dumps(value, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _digest(file: Path) -> str:
    with file.open("rb") as opened:
        return hashlib.file_digest(opened, "sha256").hexdigest()


def _aside(folder: Path, name: str) -> Path:
    """Where a file is until its set is complete."""
    return folder / f"{Path(name).stem}.new{Path(name).suffix}"


@contextlib.contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """Wait until no other process writes a set into the folder; a killed one waits for nobody.

    Where the system knows no such locks, nothing is waited for.
    """
    handle = None
    with contextlib.suppress(ImportError, OSError):
        import fcntl  # Windows has none

        handle = os.open(folder, os.O_RDONLY)
        fcntl.flock(handle, fcntl.LOCK_EX)
    try:
        yield
    finally:
        if handle is not None:
            os.close(handle)


@contextlib.contextmanager
def _uninterrupted() -> Iterator[None]:
    """Ctrl-C and SIGTERM wait for the end of the block: HDF5 cannot be interrupted in mid-write."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    came: list[int] = []
    signals = (signal.SIGINT, signal.SIGTERM)
    before = [signal.signal(one, lambda number, _: came.append(number)) for one in signals]
    try:
        yield
    finally:
        for one, handler in zip(signals, before, strict=True):
            signal.signal(one, handler)
    for number in came[:1]:
        signal.raise_signal(number)
