"""What a request asks for, within limits; a wrong one is refused with words, never by a failure."""

import asyncio
import json
import math
from collections.abc import Mapping
from http import HTTPStatus
from typing import Any

from starlette.requests import ClientDisconnect, Request
from starlette.responses import JSONResponse

from hysteresis import InputError
from hysteresis._limits import parse_json

from ._controls import worded
from ._measurement import as_document

LARGEST_BODY = 1_000_000
"""Bytes of a body that is not an upload: a page sends some hundred."""
LONGEST = 1000
"""Characters of a text; a name of a file has at most 255 bytes."""
PATIENCE = 30.0
"""Seconds in which a body must arrive."""


class RequestError(Exception):
    """A request is at fault, not the user's files or settings: a status, and words for the page."""

    def __init__(self, status: HTTPStatus, message: str, *, cause: str = "", fix: str = ""):
        super().__init__(message)
        self.status, self.cause, self.fix = status, cause, fix


class Asked:
    """The query of a request, the parts of its path and the object of its body, each entry by its kind.

    Every method raises `RequestError` for an entry that is missing or of another kind.
    """

    def __init__(self, given: Mapping[str, Any]):
        self._given = given

    def text(self, name: str, default: str | None = None) -> str:
        """A text of at most `LONGEST` characters."""
        value = self._given.get(name, default)
        if not isinstance(value, str) or len(value) > LONGEST:
            raise _bad(f"{name} is not a text of at most {LONGEST} characters.")
        return value

    def number(self, name: str) -> float | None:
        """A finite number, None where there is none."""
        value = self._given.get(name)
        return None if value in (None, "") else _number(name, value)

    def whole(self, name: str) -> int:
        """A whole number that a float holds exactly."""
        value = _number(name, self._given.get(name))
        if value != int(value) or abs(value) >= 2**53:
            raise _bad(f"{name} is not a whole number.")
        return int(value)

    def box(self) -> list[float] | None:
        """Least and greatest input, least and greatest output; None where there is no box."""
        value = self._given.get("box")
        if value in (None, ""):
            return None
        edges = value.split(",") if isinstance(value, str) else value
        if not isinstance(edges, list) or len(edges) != 4:
            raise _bad("A box has four edges.")
        return [_number("box", edge) for edge in edges]

    def texts(self, name: str) -> list[str]:
        """A list of texts."""
        value = self._given.get(name)
        if not isinstance(value, list):
            raise _bad(f"{name} is not a list.")
        return [Asked({name: one}).text(name) for one in value]

    def table(self, name: str) -> dict[str, Any] | None:
        """An object, None where there is none."""
        value = self._given.get(name)
        if not isinstance(value, dict | None):
            raise _bad(f"{name} is not an object.")
        return value

    def numbers(self, name: str) -> dict[str, float]:
        """An object of numbers."""
        return {key: _number(key, value) for key, value in (self.table(name) or {}).items()}


async def asked_of(request: Request) -> Asked:
    """What a request asks for. Raises `RequestError` for a body that is not JSON, too large or too slow."""
    given: dict[str, Any] = dict(request.query_params) | dict(request.path_params)
    if request.method == "POST":
        raw = await _body(request)
        try:
            body = parse_json(raw or b"{}")
        except ValueError as error:
            raise _bad(f"The body cannot be read as JSON: {str(error)[:100]}.") from None
        if not isinstance(body, dict):
            raise _bad("The body is not a JSON object.")
        given |= body
    return Asked(given)


async def _body(request: Request) -> bytes:
    body = bytearray()
    try:
        async with asyncio.timeout(PATIENCE):
            async for piece in request.stream():
                body += piece
                if len(body) > LARGEST_BODY:
                    said = f"This request has more than {LARGEST_BODY:,} bytes."
                    raise RequestError(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, said)
    except (TimeoutError, ClientDisconnect):
        said = f"The body was not sent in {PATIENCE:g} s."
        raise RequestError(HTTPStatus.REQUEST_TIMEOUT, said) from None
    return bytes(body)


def refusal(error: Exception) -> "Json":
    """What went wrong, as the page shows it; status 422 where it is about files and settings."""
    if isinstance(error, InputError):
        return Json({"error": as_document(error)}, HTTPStatus.UNPROCESSABLE_ENTITY)
    status, cause, fix, said = HTTPStatus.UNPROCESSABLE_ENTITY, "", "", str(error)
    if isinstance(error, OSError):
        said = f"{error.strerror or error}."
    elif isinstance(error, RequestError):
        status, cause, fix = error.status, error.cause, error.fix
    code = status.phrase.lower().replace(" ", "-")
    return Json(
        {"error": {"code": code, "message": said, "where": "", "cause": cause, "fix": fix}}, status
    )


class Json(JSONResponse):
    """JSON in ASCII: a name of a file may hold bytes that are no UTF-8. Its texts for people name the
    controls of the page in place of options."""

    def render(self, content: Any) -> bytes:
        """The bytes of the answer."""
        return json.dumps(worded(content), allow_nan=False, separators=(",", ":")).encode("ascii")


def _number(name: str, value: Any) -> float:
    try:
        number = math.nan if isinstance(value, bool) else float(value)
    except (TypeError, ValueError, OverflowError):
        number = math.nan
    if not math.isfinite(number):
        raise _bad(f"{name} is not a number.")
    return number


def _bad(said: str) -> RequestError:
    return RequestError(HTTPStatus.BAD_REQUEST, said, fix="Load the page again.")
