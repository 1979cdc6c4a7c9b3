"""The studio's answers: JSON for the page, rows as plain numbers, files of the folder."""

import contextlib
import functools
import json
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles

from compensate.export.targets._export_to import TARGETS
from hysteresis import InputError
from hysteresis._format import plain
from identify.batch._fit_many import SIDE_BY_SIDE

from . import _configuration
from ._controls import ROLES, settings, worded
from ._equivalents import equivalents, header_name, target_name
from ._folder import Folder, upload_to, zipped
from ._guard import DOCUMENT_RULES
from ._measurement import Measurement, as_document
from ._processes import Jobs
from ._results import Fits, written_rows
from ._views import of_loops, over_time

STATIC = Path(__file__).parent / "static"
COMPARISON = "comparison"
"""The folder of the page that compares fits."""
ABOUT = ("value", "file", "target", "made", "stamp")
"""What is remembered of a command: the fit, file and target it is for, and when these were made."""
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
        self._measurements: dict[Path, Measurement] = {}

    def measurement(self, name: str) -> Measurement:
        """A measurement of the folder by its name."""
        file = self.folder.file(name)
        with self._lock:
            if file not in self._measurements:
                self._measurements = {
                    **dict([*self._measurements.items()][-2:]),
                    file: Measurement(file),
                }
            return self._measurements[file]

    def place(self, name: str, value: str = "") -> Path:
        """The folder of the fit of a measurement, or of one of its values."""
        place = self.folder.fit_of(self.folder.file(name))
        return place / value if value else place

    def state(self) -> dict[str, Any]:
        """What every page asks for now and then."""
        return {
            "folder": self.folder.root.name,
            "version": self.jobs.version,
            "files": self.folder.listed(),
            "jobs": self.jobs.listed(),
            "models": self._models,
            "constants": list(SIDE_BY_SIDE),
            "targets": [target for target in TARGETS if target not in ("c", "runtime")],
            "roles": ROLES,
            "settings": settings(),
        }

    def look(self, name: str) -> dict[str, Any]:
        """A measurement, its fit and the lines that do the same; of a large file only the head is read."""
        one = self.measurement(name)
        found = one.look()
        selection = None
        with contextlib.suppress(InputError):  # `look` has told it as the fault
            selection = _configuration.selection(one.config)
        place = self.place(name)
        try:
            found["result"] = None
            if place.exists():
                asked = found["fit"]
                found["result"] = self.fits.summary(place, selection, asked, file=one.file)
                found["seen"] = self.folder.copies(one.file)
        except InputError as error:
            if error.code != "file-not-found":
                found["result_fault"] = as_document(error)
        shown = (found["result"] or {}).get("folder", ".")
        found["equivalents"] = equivalents(one.file, place, selection, found["fit"], shown)
        return found

    def change(self, name: str, changes: dict[str, dict[str, Any]]) -> None:
        """Change the configuration of a measurement."""
        self.measurement(name).change(changes)
        self.jobs.touched()

    def start(self, kind: str, name: str, options: dict[str, Any]) -> dict[str, Any]:
        """Start a command about a measurement: fit, sample, qualify, predict, export or report."""
        file = self.folder.file(name)
        place = self.place(name, str(options.get("value", "")))
        self.folder.inside(place.relative_to(self.folder.root).as_posix())
        out = self.folder.fit_of(file)
        at, source = (path.relative_to(self.folder.root).as_posix() for path in (place, file))
        if kind == "fit":
            config = file.with_suffix(".toml").relative_to(self.folder.root).as_posix()
            words = ["fit", _path(source), "--config", _path(config), "--overwrite"]
            words += ["--out", _path(out.relative_to(self.folder.root).as_posix())]
        elif kind == "sample":
            words = ["sample", _path(at)]
        elif kind == "export":
            header = f"{at}/{header_name(place)}"
            words = [
                "export",
                _path(at),
                "--c",
                _path(header),
                "--runtime",
                _path(f"{at}/compensator.json"),
            ]
            if target := str(options.get("target", "")):
                if target not in TARGETS:
                    raise InputError("bad-option", f"There is no target {target!r}.")
                written = f"{at}/{target_name(place, target)}"
                self.folder.inside(written)
                words = ["export", _path(at), "--to", target, _path(written)]
        elif kind == "report":
            words = ["report", _path(at)]
        elif kind in ("qualify", "predict"):
            other = (
                self.folder.file(str(options.get("file", "")))
                .relative_to(self.folder.root)
                .as_posix()
            )
            words = [kind, _path(at), _path(other), *(["--inverse"] if kind == "predict" else [])]
        else:
            raise InputError("bad-option", f"There is no command {kind!r}.")
        about = {key: options[key] for key in ABOUT if key in options}
        return self.jobs.start(kind, name, words, about).document

    def compare(self, names: Sequence[str]) -> dict[str, Any]:
        """Start the page that compares the fits of several measurements."""
        places = [self.place(name).relative_to(self.folder.root).as_posix() for name in names]
        words = ["report", *map(_path, places), "--out", COMPARISON]
        return self.jobs.start("compare", COMPARISON, words, {"value": "\n".join(names)}).document


def app_of(studio: Studio) -> Starlette:
    """The web application of a studio, without the guard."""
    routes = [
        Route("/", _page),
        Route("/api/state", _answer(studio, _state)),
        Route("/api/look", _answer(studio, _look)),
        Route("/api/judged", _answer(studio, _judged)),
        Route("/api/series", _answer(studio, _series)),
        Route("/api/lines", _answer(studio, _lines)),
        Route("/api/change", _answer(studio, _change), methods=["POST"]),
        Route("/api/again", _answer(studio, _again), methods=["POST"]),
        Route("/api/brush", _answer(studio, _brush), methods=["POST"]),
        Route("/api/start", _answer(studio, _start), methods=["POST"]),
        Route("/api/compare", _answer(studio, _compare), methods=["POST"]),
        Route("/api/cancel", _answer(studio, _cancel), methods=["POST"]),
        Route("/api/curves", _answer(studio, _curves)),
        Route("/api/redraw", _answer(studio, _redraw), methods=["POST"]),
        Route("/api/posterior", _answer(studio, _posterior)),
        Route("/api/summary", _answer(studio, _summary)),
        Route("/api/written", _answer(studio, _written)),
        Route("/api/upload", functools.partial(_upload, studio), methods=["POST"]),
        Route("/files/{name:path}", _answer(studio, _file)),
        Mount("/static", StaticFiles(directory=STATIC)),
    ]
    return Starlette(routes=routes)


async def _page(_: Request) -> Response:
    return FileResponse(STATIC / "index.html")


def _answer(studio: Studio, handler: Callable[[Studio, Any], Any]) -> Any:
    """A route: the handler in a thread, with query and body; a fault of the user's is status 422."""

    async def answer(request: Request) -> Response:
        asked: dict[str, Any] = dict(request.query_params) | dict(request.path_params)
        if request.method == "POST":
            try:
                body = json.loads(await request.body() or b"{}")
            except ValueError:
                body = None
            if not isinstance(body, dict):
                return JSONResponse({"error": {"code": "bad-request", "message": "Not JSON."}}, 400)
            asked |= body
        return await run_in_threadpool(_safely, handler, studio, asked)

    return answer


def _safely(handler: Any, studio: Studio, asked: dict[str, Any]) -> Response:
    try:
        found = handler(studio, asked)
    except InputError as error:
        return JSONResponse(worded({"error": as_document(error)}), 422)
    except OSError as error:
        said = f"{error.strerror or error}."
        return JSONResponse({"error": {"code": "os-error", "message": said}}, 422)
    except (KeyError, TypeError) as error:
        said = f"This request is not complete ({type(error).__name__} {error})."
        return JSONResponse({"error": {"code": "bad-request", "message": said}}, 400)
    return found if isinstance(found, Response) else JSONResponse(worded(plain(found)))


def _state(studio: Studio, asked: Any) -> Any:
    return studio.state()


def _look(studio: Studio, asked: Any) -> Any:
    return studio.look(asked["name"])


def _judged(studio: Studio, asked: Any) -> Any:
    return studio.measurement(asked["name"]).judged()


def _series(studio: Studio, asked: Any) -> Response:
    """Rows over time and of loops as float64, one after the other; what they are is in a header."""
    series, whole, names = studio.measurement(asked["name"]).series()
    low, high = _number(asked.get("low")), _number(asked.get("high"))
    box = asked.get("box")
    edges = [float(x) for x in str(box).split(",")] if box else None
    if edges is not None and len(edges) != 4:
        raise InputError("bad-option", "A box has four edges.")
    parts, joined = [], True
    if asked.get("part") != "loops":
        parts.append(over_time(series, low, high))
    if asked.get("part") != "time":
        loops, joined = of_loops(series, low, high, None if edges is None else (*edges,))  # type: ignore[arg-type]
        parts.append(loops)
    about = {
        "shapes": [part.shape[1] for part in parts], "whole": whole, "joined": joined,
        "rows": len(series.x), "names": names, "clock": not np.array_equal(series.x, series.line),
    }  # fmt: skip
    content = b"".join(np.ascontiguousarray(part, "<f8").tobytes() for part in parts)
    # Names of columns may hold anything: in JSON they are ASCII.
    return Response(
        content, media_type="application/octet-stream", headers={"x-about": json.dumps(about)}
    )


def _lines(studio: Studio, asked: Any) -> Any:
    """The clock at the first and at the last of some lines."""
    series = studio.measurement(asked["name"]).series()[0]
    ends = np.searchsorted(series.line, [int(asked["first"]), int(asked["last"])])
    low, high = series.x[np.minimum(ends, len(series.x) - 1)]
    return {"low": float(low), "high": float(high)}


def _change(studio: Studio, asked: Any) -> Any:
    studio.change(
        asked["name"], {key: dict(asked[key]) for key in ("selection", "fit") if key in asked}
    )
    return studio.look(asked["name"])


def _again(studio: Studio, asked: Any) -> Any:
    """Guess the configuration anew; the one that was there is kept as FILE.toml.bak."""
    one = studio.measurement(asked["name"])
    if one.config.exists():
        one.config.replace(one.config.with_suffix(".toml.bak"))
    try:
        one.configured()
    finally:
        studio.jobs.touched()
    return studio.look(asked["name"])


def _brush(studio: Studio, asked: Any) -> Any:
    one = studio.measurement(asked["name"])
    changes = one.brush(
        asked["action"], _number(asked.get("low")), _number(asked.get("high")), asked.get("box")
    )
    studio.change(asked["name"], {"selection": changes})
    return studio.look(asked["name"])


def _start(studio: Studio, asked: Any) -> Any:
    return studio.start(asked["kind"], asked["name"], asked)


def _compare(studio: Studio, asked: Any) -> Any:
    return studio.compare([str(name) for name in asked["names"]])


def _cancel(studio: Studio, asked: Any) -> Any:
    studio.jobs.cancel(int(asked["number"]))
    return {}


def _summary(studio: Studio, asked: Any) -> Any:
    one, value = studio.measurement(asked["name"]), asked.get("value", "")
    selection, fit = _configuration.selection(one.config), _configuration.read(one.config)["fit"]
    return studio.fits.summary(studio.place(asked["name"]), selection, fit, value, one.file)


def _curves(studio: Studio, asked: Any) -> Any:
    return studio.fits.curves(_fit_place(studio, asked))


def _redraw(studio: Studio, asked: Any) -> Any:
    values, factors = (
        {str(name): float(value) for name, value in asked[key].items()}
        for key in ("values", "factors")
    )
    return studio.fits.redrawn(_fit_place(studio, asked), values, factors)


def _posterior(studio: Studio, asked: Any) -> Any:
    return studio.fits.posterior_marginals(_fit_place(studio, asked))


def _written(studio: Studio, asked: Any) -> Any:
    stem = studio.folder.file(asked["file"]).stem
    written = _fit_place(studio, asked) / f"inverse-{stem}.csv"
    name = written.relative_to(studio.folder.root).as_posix()
    return written_rows(studio.folder.file(name), inverse=True)


def _fit_place(studio: Studio, asked: Any) -> Path:
    place = studio.place(asked["name"], asked.get("value", ""))
    studio.folder.inside(place.relative_to(studio.folder.root).as_posix())
    return place


def _file(studio: Studio, asked: Any) -> Response:
    """A file of the folder: a report to look at, which can run nothing; else a download, folders as ZIP."""
    file = studio.folder.inside(asked["name"])
    if file.is_dir() and "download" in asked:
        headers = {"content-disposition": f"attachment; filename*=utf-8''{quote(file.name)}.zip"}
        return Response(zipped(file), media_type="application/zip", headers=headers)
    file = studio.folder.file(asked["name"])
    if file.suffix == ".html" and "download" not in asked:
        rules = {"content-security-policy": DOCUMENT_RULES}
        return FileResponse(file, media_type="text/html", headers=rules)
    return FileResponse(file, media_type="application/octet-stream", filename=file.name)


async def _upload(studio: Studio, request: Request) -> Response:
    """Take a file that was dropped; the same file again is not kept twice."""
    name = request.query_params.get("name", "")
    path = studio.folder.new_file(name)
    size = 0
    with upload_to(path) as new:
        with new.open("wb") as opened:
            async for piece in request.stream():
                size += len(piece)
                if size > LARGEST:
                    raise HTTPException(413, "This file is too large to be dropped; copy it here.")
                opened.write(piece)
        twin = studio.folder.twin(name, new)
    if twin is not None:
        path.unlink()
        path = twin
    studio.jobs.touched()
    return JSONResponse({"name": path.relative_to(studio.folder.root).as_posix()})


def _number(value: Any) -> float | None:
    if value in (None, ""):
        return None
    number = float(value)
    return number if np.isfinite(number) else None


def _path(name: str) -> str:
    """A name of a file that no option parser takes for an option."""
    return f"./{name}" if name.startswith("-") else name
