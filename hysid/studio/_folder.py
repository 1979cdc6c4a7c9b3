"""The folder of a studio: its measurements, and names that lead out of it refused."""

import contextlib
import filecmp
import io
import os
import re
import zipfile
from collections.abc import Iterable, Iterator
from http import HTTPStatus
from pathlib import Path
from typing import Any

import identify
from hysteresis import InputError

from ..intake._own_config import config_of, folder_of
from ._requests import RequestError

MEASUREMENTS = (
    ".csv", ".tsv", ".txt", ".dat", ".asc", ".log", ".lvm", ".tdms", ".xls", ".xlsx", ".xlsb", ".ods",
    ".mat", ".h5", ".hdf5", ".parquet", ".bag", ".db3", ".mcap",
)  # fmt: skip
"""Ends of names that are offered for choosing; any other file can be named on the command line."""
LONGEST_NAME = 120
"""Bytes of the name of an upload."""
LARGEST_ARCHIVE = 500_000_000
"""Bytes that are packed into an archive."""


class Folder:
    """A folder of measurements: each has its configuration and the folder of its fit beside it.

    **Arguments:**

    - `root`: the folder. Nothing outside of it is read or written.
    - `named`: further files in it that are offered, whatever their names end in.
    """

    def __init__(self, root: Path, named: Iterable[Path] = ()):
        self.root = root.resolve()
        self._coming: set[Path] = set()
        self._named = {
            self.inside(path.resolve().relative_to(self.root).as_posix()) for path in named
        }

    def inside(self, name: str) -> Path:
        """The path of a name in the folder.

        Raises `InputError` `outside-folder`, also for a link that leads out of it.
        """
        path = self.root / name
        odd = not name or "\0" in name or any(part.startswith(".") for part in Path(name).parts)
        if odd or not _is_name(name) or self._leads_out(path):
            raise InputError(
                "outside-folder",
                f"{name[:LONGEST_NAME]!r} is not a file of this folder.",
                place=str(self.root),
                fix="Copy the file into the folder, or start hysid studio there.",
            )
        return path

    def config_of(self, file: Path) -> Path:
        """The configuration of a measurement. Raises `InputError` `outside-folder`, `bad-option`."""
        if file.suffix == ".toml":
            raise InputError("bad-option", "A configuration is not a measurement.", place=file.name)
        return self.inside(config_of(file).relative_to(self.root).as_posix())

    def fit(self, place: Path) -> Path:
        """The folder of a fit, or of one of its values.

        Raises `InputError` `outside-folder` where it leads out of the folder, or a link in it does.
        """
        own = place.is_relative_to(self.root)
        self.inside(str(place.relative_to(self.root) if own else place))
        if (place / "fit.json").is_file():
            for found in (*place.glob("*"), *place.glob("*/*")):
                if found.is_symlink() and self._leads_out(found):
                    self.inside(found.relative_to(self.root).as_posix())
        return place

    def _leads_out(self, path: Path) -> bool:
        real = Path(os.path.realpath(path))
        return real == self.root or not real.is_relative_to(self.root)

    def file(self, name: str) -> Path:
        """A file of the folder. Raises `InputError` `file-not-found`, `outside-folder`."""
        path = self.inside(name)
        if not path.is_file():
            raise InputError(
                "file-not-found", "The file is not there any more.", place=name,
                fix="Choose another one.",
            )  # fmt: skip
        return path

    def measurements(self) -> list[Path]:
        """The files that can be fitted, by name."""
        found = {
            path
            for path in self.root.iterdir()
            if path.suffix.lower() in MEASUREMENTS and not path.name.startswith(".") and path.is_file()
            and path.resolve().is_relative_to(self.root)
        }  # fmt: skip
        return sorted(found | {path for path in self._named if path.is_file()})

    def listed(self) -> list[dict[str, Any]]:
        """Every measurement with what there is of it: configuration, and the verdict of its fit.

        `stamp`, `edited`: when the file and its configuration were written.
        """
        return [
            {
                "name": file.relative_to(self.root).as_posix(),
                "size": file.stat().st_size,
                "stamp": str(file.stat().st_mtime),
                "configured": (config := config_of(file)).is_file(),
                "edited": str(config.stat().st_mtime) if config.is_file() else "",
                "fit": self._verdict(folder_of(file)),
            }
            for file in self.measurements()
        ]

    def _verdict(self, place: Path) -> dict[str, str] | None:
        """The verdict of the fit in a folder, None where there is none in it."""
        with contextlib.suppress(InputError):
            if (self.fit(place) / "fit.json").is_file():
                try:
                    return {"level": identify.internal.read_document(place)["verdict"]["level"]}
                except (InputError, KeyError):
                    return {"level": "damaged"}
        return None

    @contextlib.contextmanager
    def new_file(self, name: str) -> Iterator[Path]:
        """A free path for an upload of this name, which may be any; no other upload gets it meanwhile."""
        stem, dot, suffix = Path(name.replace("\\", "/")).name.rpartition(".")
        stem, suffix = (stem, f".{suffix}") if dot else (suffix, "")
        stem = _cut(re.sub(r"[^\w .()+=-]", "_", stem).strip(" ."), LONGEST_NAME) or "measurement"
        suffix = _cut(re.sub(r"[^\w.]", "_", suffix), 12)
        path, number = self.root / f"{stem}{suffix}", 1
        while path in self._coming or any(
            map(os.path.lexists, (path, path.with_suffix(".toml"), folder_of(path)))
        ):
            number += 1
            path = self.root / f"{stem}-{number}{suffix}"
        self._coming.add(path)
        try:
            yield path
        finally:
            self._coming.discard(path)

    def copies(self, file: Path) -> list[str]:
        """The names of the measurements that hold the same bytes as a file, its own name included."""
        size = file.stat().st_size
        return [
            path.relative_to(self.root).as_posix()
            for path in self.measurements()
            if path.stat().st_size == size and filecmp.cmp(path, file, shallow=False)
        ]

    def twin(self, name: str, content: Path) -> Path | None:
        """The measurement of this name that holds the same bytes as an uploaded file."""
        try:
            path = self.inside(Path(name.replace("\\", "/")).name)
        except InputError:
            return None
        return path if path.is_file() and filecmp.cmp(path, content, shallow=False) else None


def _is_name(name: str) -> bool:
    """Whether the system could have a file of this name."""
    try:
        return max(map(len, os.fsencode(name).split(b"/"))) <= 255
    except UnicodeEncodeError:
        return False


def _cut(text: str, most: int) -> str:
    """The beginning of a text, of so many bytes at most."""
    return text.encode()[:most].decode(errors="ignore")


def zipped(folder: Path) -> bytes:
    """The files below a folder as a ZIP archive, without links. Raises `RequestError` where it is large."""
    found = io.BytesIO()
    files = [
        Path(at, name) for at, _, names in os.walk(folder) for name in names
        if Path(at, name).is_file() and not Path(at, name).is_symlink()
    ]  # fmt: skip
    if sum(file.stat().st_size for file in files) > LARGEST_ARCHIVE:
        said = "This folder is too large to be sent."
        raise RequestError(
            HTTPStatus.REQUEST_ENTITY_TOO_LARGE, said, fix="Copy it by another program."
        )
    with zipfile.ZipFile(found, "w", zipfile.ZIP_DEFLATED) as archive:
        for file in sorted(files):
            archive.write(file, file.relative_to(folder.parent))
    return found.getvalue()
