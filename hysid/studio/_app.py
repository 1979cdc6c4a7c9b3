"""The studio's answers: JSON for the page, rows as plain numbers, files of the folder."""

import contextlib
import functools
import itertools
import json
import threading
from collections.abc import Callable, Mapping, Sequence
from http import HTTPStatus
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import FileResponse, Response
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles

from compensate.export.targets._export_to import TARGETS
from hysteresis import InputError
from hysteresis._files import atomic_file
from hysteresis._format import plain
from hysteresis._limits import damage_told

from ..commands._asked import CHAINS, Command, Export, Fit, Report
from ..intake._own_config import folder_of
from . import _equivalents
from ._equivalents import asked_for, equivalents
from ._folder import Folder, zipped
from ._measurement import Measurement
from ._processes import Jobs
from ._requests import (
    DOCUMENT_RULES,
    ROLES,
    Asked,
    Json,
    RequestError,
    Sessions,
    asked_of,
    refusal,
    settings,
)
from ._results import Fits, written_rows
from ._views import as_bytes, of_loops, over_time

STATIC = Path(__file__).parent / "static"
COMPARISON = "comparison"
"""The folder of the page that compares fits."""
ABOUT = ("value", "file", "target", "made", "stamp")
"""What is remembered of a command: the fit, file and target it is for, and when these were made."""
FAULTS = (InputError, OSError, RequestError)
"""What is refused with words; any other exception is a fault of ours, and is status 500."""
CONSTANTS = ("LinearSponge", "Burgers", "FoamCurve", "BoucWen")
"""What is compared where a model with named constants is wanted."""
LARGEST = 4 * 2**30
"""Bytes of an upload."""


class Studio:
    """One folder with its measurements, fits and commands, as the page asks for them."""

    def __init__(self, folder: Folder, models: Sequence[str]):
        self.folder = folder
        self._models = list(models)
        self.jobs = Jobs(folder.root)
        self.fits = Fits()
        self._lock = threading.Lock()
        self._opened = functools.lru_cache(3)(Measurement)
        self._changing: dict[Path, threading.RLock] = {}

    def measurement(self, name: str) -> Measurement:
        """A measurement of the folder by its name."""
        file = self.folder.file(name)
        self.folder.config_of(file)
        with self._lock:
            return self._opened(file)

    def changing(self, name: str) -> threading.RLock:
        """What is held from reading the configuration of a measurement to writing it: no change is lost."""
        config = self.folder.config_of(self.folder.file(name))
        with self._lock:
            return self._changing.setdefault(config, threading.RLock())

    def place(self, name: str, value: str = "") -> Path:
        """The folder of the fit of a measurement, or of one of its values, whether there is one or not."""
        place = folder_of(self.folder.file(name))
        return self.folder.fit(place / value if value else place)

    def state(self) -> dict[str, Any]:
        """What every page asks for now and then."""
        return {
            "folder": self.folder.root.name,
            "version": self.jobs.version,
            "files": self.folder.listed(),
            "jobs": self.jobs.listed(),
            "models": self._models,
            "constants": list(CONSTANTS),
            "targets": [target for target in TARGETS if target not in ("c", "runtime")],
            "roles": ROLES,
            "settings": settings(),
        }

    def look(self, name: str) -> dict[str, Any]:
        """A measurement, its fit and the lines that do the same; of a large file only the head is read."""
        one = self.measurement(name)
        with self.changing(name):  # it may write the configuration
            found = one.look()
        selection = None
        with contextlib.suppress(InputError):  # `look` has told it as the fault
            selection = _equivalents.selection(one.config)
        place = self.place(name)
        try:
            found["result"] = None
            if place.exists():
                with damage_told("The fit", place, "Fit again."):
                    asked = found["fit"]
                    found["result"] = self.fits.summary(place, selection, asked, file=one.file)
                found["seen"] = self.folder.copies(one.file)
        except InputError as error:
            if error.code != "file-not-found":
                found["result_fault"] = error.document
        shown = (found["result"] or {}).get("folder", ".")
        found["equivalents"] = equivalents(one.file, place, selection, found["fit"], shown)
        return found

    def change(self, name: str, changes: dict[str, dict[str, Any]]) -> None:
        """Change the configuration of a measurement, which is that of the guess before the first change."""
        one = self.measurement(name)
        with self.changing(name):
            with contextlib.suppress(InputError):  # a file that is not understood has roles by hand
                one.configured()
            one.change(changes)
        self.jobs.touched()

    def start(self, kind: str, name: str, options: Mapping[str, str]) -> dict[str, Any]:
        """Start a command about a measurement: fit, sample, qualify, predict, export or report."""
        one, place = self.measurement(name), self.place(name, options.get("value", ""))
        if kind == "fit":
            _equivalents.read(one.config)  # the command follows every name in it
            file, config, out = map(self._here, (one.file, one.config, self.place(name)))
            asked: Command = Fit(file=file, config=config, out=out, overwrite=True)
        else:
            if not (place / "fit.json").is_file():
                raise InputError(
                    "file-not-found", "There is no fit yet.", place=name, fix="Press Fit."
                )
            tried = kind in ("qualify", "predict")
            file = self._here(self.folder.file(options.get("file", ""))) if tried else Path()
            target, sampled = options.get("target", ""), (place / CHAINS).exists()
            asked = asked_for(kind, self._here(place), file, target, sampled)
            if isinstance(asked, Export) and asked.to is not None:
                self.folder.inside(asked.to[1].as_posix())
        about = {key: options[key] for key in ABOUT if key in options}
        return self.jobs.start(kind, name, asked.words, about).document

    def compare(self, names: Sequence[str]) -> dict[str, Any]:
        """Start the page that compares the fits of several measurements."""
        asked = Report(
            folders=[self._here(self.place(name)) for name in names], out=Path(COMPARISON)
        )
        about = {"value": "\n".join(names)}
        return self.jobs.start("compare", COMPARISON, asked.words, about).document

    def _here(self, path: Path) -> Path:
        """A path as the commands have it, which run in the folder."""
        return path.relative_to(self.folder.root)


def app_of(studio: Studio, sessions: Sessions) -> Starlette:
    """The web application of a studio, without the guard. What GET asks for changes nothing on the disk."""
    read = {
        "state": lambda _, asked: studio.state(),
        "judged": lambda _, asked: studio.measurement(asked.text("name")).judged(),
        "curves": lambda _, asked: studio.fits.curves(_fit_place(studio, asked)),
        "posterior": lambda _, asked: studio.fits.posterior_marginals(_fit_place(studio, asked)),
        "link": functools.partial(_link, sessions),
        "series": _series, "lines": _lines, "summary": _summary, "written": _written,
    }  # fmt: skip
    write = {
        "look": lambda _, asked: studio.look(asked.text("name")),
        "compare": lambda _, asked: studio.compare(asked.texts("names")),
        "enter": lambda _, asked: {"session": sessions.enter(asked.text("token"))},
        "cancel": lambda _, asked: studio.jobs.cancel(asked.whole("number")) or {},
        "start": lambda _, asked: studio.start(
            asked.text("kind"), asked.text("name"), {key: asked.text(key, "") for key in ABOUT}
        ),
        "redraw": lambda _, asked: studio.fits.redrawn(
            _fit_place(studio, asked), asked.numbers("values"), asked.numbers("factors")
        ),
        "change": _change, "again": _again, "brush": _brush,
    }  # fmt: skip
    routes = [
        Route("/", _page),
        *(
            Route(f"/api/{name}", _answer(studio, does), methods=[method])
            for method, known in (("GET", read), ("POST", write))
            for name, does in known.items()
        ),
        Route("/api/upload", functools.partial(_upload, studio), methods=["POST"]),
        Route("/files/{name:path}", _answer(studio, _file)),
        Mount("/static", StaticFiles(directory=STATIC)),
    ]
    app = Starlette(routes=routes, exception_handlers={HTTPException: _nothing})
    app.router.redirect_slashes = False
    return app


async def _page(_: Request) -> Response:
    return FileResponse(STATIC / "index.html")


async def _nothing(request: Request, error: Exception) -> Response:
    """The answer at an address where there is nothing, or to a method that it does not have."""
    status = HTTPStatus(error.status_code if isinstance(error, HTTPException) else 404)
    return refusal(
        RequestError(status, f"The studio answers no {request.method:.20} at this address.")
    )


def _answer(studio: Studio, handler: Callable[[Studio, Asked], Any]) -> Any:
    """A route: the handler in a thread, with query and body; a fault of the user's is status 422."""

    def does(asked: Asked) -> Response:
        found = handler(studio, asked)
        return found if isinstance(found, Response) else Json(plain(found))

    async def answer(request: Request) -> Response:
        try:
            return await run_in_threadpool(does, await asked_of(request))
        except FAULTS as error:
            return refusal(error)

    return answer


def _link(sessions: Sessions, studio: Studio, asked: Asked) -> Any:
    """The address of a file of the folder, which can be opened without a header."""
    studio.folder.inside(asked.text("name"))
    return {"address": sessions.link(asked.text("name"))}


def _series(studio: Studio, asked: Asked) -> Response:
    """Rows over time and of loops as float64, one after the other; what they are is in a header."""
    series, whole, names = studio.measurement(asked.text("name")).series()
    low, high, part = asked.number("low"), asked.number("high"), asked.text("part", "")
    parts, joined = [], True
    if part != "loops":
        parts.append(over_time(series, low, high))
    if part != "time":
        loops, joined = of_loops(series, low, high, asked.box())
        parts.append(loops)
    about = {
        "shapes": [part.shape[1] for part in parts], "whole": whole, "joined": joined,
        "rows": len(series.x), "names": names, "clock": not np.array_equal(series.x, series.line),
    }  # fmt: skip
    # Names of columns may hold anything: in JSON they are ASCII.
    headers = {"x-about": json.dumps(about)}
    return Response(as_bytes(*parts), media_type="application/octet-stream", headers=headers)


def _lines(studio: Studio, asked: Asked) -> Any:
    """The clock at the first and at the last of some lines."""
    series = studio.measurement(asked.text("name")).series()[0]
    ends = [np.abs(series.line - asked.whole(end)).argmin() for end in ("first", "last")]
    low, high = np.sort(series.x[ends])
    return {"low": float(low), "high": float(high)}


def _change(studio: Studio, asked: Asked) -> Any:
    name = asked.text("name")
    tables = {key: asked.table(key) for key in ("selection", "fit")}
    studio.change(name, {key: table for key, table in tables.items() if table})
    return studio.look(name)


def _again(studio: Studio, asked: Asked) -> Any:
    """Guess the configuration anew; the one that was there is kept as FILE.toml.bak, .bak1, ..."""
    name = asked.text("name")
    one = studio.measurement(name)
    with studio.changing(name):
        if one.config.exists():
            names = (one.config.with_suffix(f".toml.bak{k or ''}") for k in itertools.count())
            one.config.replace(next(path for path in names if not path.exists()))
        try:
            one.configured()
        finally:
            studio.jobs.touched()
    return studio.look(name)


def _brush(studio: Studio, asked: Asked) -> Any:
    name, action = asked.text("name"), asked.text("action")
    with studio.changing(name):
        changes = studio.measurement(name).brush(
            action, asked.number("low"), asked.number("high"), asked.box()
        )
        studio.change(name, {"selection": changes})
    return studio.look(name)


def _summary(studio: Studio, asked: Asked) -> Any:
    name, value = asked.text("name"), asked.text("value", "")
    one, place = studio.measurement(name), studio.place(name)
    selection, fit = _equivalents.selection(one.config), _equivalents.read(one.config)["fit"]
    with damage_told("The fit", place, "Fit again."):
        return studio.fits.summary(place, selection, fit, value, one.file)


def _written(studio: Studio, asked: Asked) -> Any:
    stem = studio.folder.file(asked.text("file")).stem
    written = _fit_place(studio, asked) / f"inverse-{stem}.csv"
    name = written.relative_to(studio.folder.root).as_posix()
    with damage_told("The file", written, "Try the compensator again."):
        return written_rows(studio.folder.file(name))


def _fit_place(studio: Studio, asked: Asked) -> Path:
    return studio.place(asked.text("name"), asked.text("value", ""))


def _file(studio: Studio, asked: Asked) -> Response:
    """A file of the folder: a report to look at, which can run nothing; else a download, folders as ZIP."""
    name, download = asked.text("name"), asked.text("download", "")
    file = studio.folder.inside(name)
    if file.is_dir() and download:
        headers = {"content-disposition": f"attachment; filename*=utf-8''{quote(file.name)}.zip"}
        return Response(zipped(file), media_type="application/zip", headers=headers)
    file = studio.folder.file(name)
    if file.suffix == ".html" and not download:
        rules = {"content-security-policy": DOCUMENT_RULES}
        return FileResponse(file, media_type="text/html", headers=rules)
    return FileResponse(file, media_type="application/octet-stream", filename=file.name)


async def _upload(studio: Studio, request: Request) -> Response:
    """Take a file that was dropped; the same file again is not kept twice."""
    name, size = request.query_params.get("name", ""), 0
    try:
        with studio.folder.new_file(name) as path:
            with atomic_file(path) as new:  # whole in the end, or not there
                with new.open("wb") as opened:
                    async for piece in request.stream():
                        size += len(piece)
                        if size > LARGEST:
                            said = "This file is too large to be dropped."
                            raise RequestError(
                                HTTPStatus.REQUEST_ENTITY_TOO_LARGE, said, fix="Copy it here."
                            )
                        opened.write(piece)
                twin = await run_in_threadpool(studio.folder.twin, name, new)
            if twin is not None:
                path.unlink()
                path = twin
    except FAULTS as error:
        return refusal(error)
    studio.jobs.touched()
    return Json({"name": path.relative_to(studio.folder.root).as_posix()})
