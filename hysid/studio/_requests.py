"""What a request asks for, within limits; a wrong one is refused with words, never by a failure."""

import asyncio
import hashlib
import hmac
import json
import math
import re
import secrets
from collections.abc import Callable, Mapping
from http import HTTPStatus
from typing import Any
from urllib.parse import quote

from starlette.datastructures import MutableHeaders
from starlette.requests import ClientDisconnect, Request
from starlette.responses import JSONResponse

from hysteresis import InputError
from hysteresis._limits import parse_json

from .._plots_script import script_rule
from ..intake._options import ASIDE, FIELDS, FIT_FIELDS

ROLES = {
    "input": "input", "output": "output", "time": "time", "input_time": "time of the input",
    "group": "separates sequences", "each": "one fit for each value", "condition": "condition",
    "sigma": "standard deviation",
}  # fmt: skip
"""Options that name columns: a role in the table of columns."""

_ELSEWHERE = {
    "input_unit": "Unit", "output_unit": "Unit", "test_cycles": "Held out for testing",
    "test_tail": "Held out for testing", "test_lines": "Hold out", "exclude_lines": "Exclude",
    "model": "Model", "purpose": "The model is meant",
}  # fmt: skip
"""Options with a control of their own elsewhere on the page."""

_SELECTION = {
    "dt": "Time between samples", "step": "Constant input", "hold": "Creep or relaxation",
    "turn": "Turned signs", "where": "Only these rows", "branch": "Branch",
    "range": "Range of the input", "test_where": "Held out by values", "nan": "Missing values",
    "segments": "New sequences", "decimal": "Decimal sign", "units_row": "Line of the units",
    "na_values": "Words for missing values", "table": "Table of the file",
}  # fmt: skip

_FIT = {
    "initial": "Memory at the start", "conditioning": "First cycle", "clocks": "Lag", "drift": "Drift",
    "noise": "Noise", "starts": "Random starts", "period": "Period", "oversampling": "Oversampling",
}  # fmt: skip
"""Further settings of a fit."""

_LABELS = ROLES | _ELSEWHERE | _SELECTION | _FIT
_BUTTONS = {
    "init": "Guess again", "fit": "Fit", "sample": "Sample the posterior", "check": "Measurement",
    "qualify": "Try the compensator", "predict": "Try the compensator", "report": "Write the report",
    "export": "Export the compensator",
}  # fmt: skip

_PROSE = frozenset({
    "message", "cause", "fix", "why", "text", "said", "notes", "reasons", "reason", "no_roles",
    "skipped", "help", "basis",
})  # fmt: skip
"""Keys whose texts people read; all others hold names, which stay as they are."""

_PLACE = r"(?:[ =]\"?[A-Z](?:[A-Z,=\[\]-]*[A-Z\]])?(?:\.[a-z]+)?\"?(?![a-z]))?"
"""A word that stands for a value in a message, such as COL or "COL" or FIRST-LAST."""
_OPTION = re.compile(rf"(?<![\w-])--([a-z][a-z0-9-]+){_PLACE}")
_WITH_OPTIONS = re.compile(rf"\bhysid [a-z]+(?: [a-z]+)?{_PLACE}{_PLACE} (?=--[a-z])")
_COMMAND = re.compile(rf"\bhysid ({'|'.join(_BUTTONS)})\b{_PLACE}{_PLACE}")


def settings() -> list[dict[str, Any]]:
    """The settings that the page offers besides roles, units and held-out rows: one for each option."""
    return [
        {
            "of": table, "name": name, "label": label, "help": said.metadata["help"],
            "choices": said.metadata.get("choices", ()), "default": said.default,
            "kind": _kind(said.type, said.metadata),
        }
        for table, labels, known in (("selection", _SELECTION, FIELDS), ("fit", _FIT, FIT_FIELDS))
        for name, label in labels.items()
        for said in (known[name],)
    ]  # fmt: skip


def on_page(text: str) -> str:
    """A text of a command that names the page's controls in place of options and commands.

    What names an option that the page lacks is left out, as long as something is left.

        >>> on_page("Give the constant input (--step VALUE), or use --overwrite.")
        'Give the constant input (“Constant input”).'
    """
    text = _WITH_OPTIONS.sub("", text)
    text = ASIDE.sub(lambda found: "" if _lacks(found[0]) else found[0], text)
    if _lacks(text):
        kept = [_without_lacking(sentence) for sentence in re.split(r"(?<=[.!?;]) ", text)]
        text = " ".join(filter(None, kept)) or text
    label = lambda name: _LABELS.get(name.replace("-", "_"), name.replace("-", " "))  # noqa: E731
    text = _OPTION.sub(lambda found: f"“{label(found[1])}”", text)
    text = _COMMAND.sub(lambda found: f"“{_BUTTONS[found[1]]}”", text)
    return text.replace("” “", "” and “")


def worded(document: Any, prose: bool = False) -> Any:
    """Plain data whose texts for people are as `on_page`."""
    if isinstance(document, dict):
        return {key: worded(value, prose or key in _PROSE) for key, value in document.items()}
    if isinstance(document, list | tuple):
        plain = not document or isinstance(document[0], int | float)
        return document if plain else [worded(one, prose) for one in document]
    return on_page(document) if prose and isinstance(document, str) else document


def _lacks(text: str) -> bool:
    return any(name.replace("-", "_") not in _LABELS for name in _OPTION.findall(text))


def _without_lacking(sentence: str) -> str:
    kept = [one for one in re.split(r",? or (?=[a-z]+ )", sentence) if not _lacks(one)]
    said = ", or ".join(kept)
    return said if not said or said[-1] in ".!?;" else f"{said}."


def _kind(hint: Any, said: Any) -> str:
    if hint is bool:
        return "check"
    if said.get("repeated") or said.get("joined"):
        return "list"
    return "number" if hint in (float | None, int | None, int) else "text"


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
    status, told = HTTPStatus.UNPROCESSABLE_ENTITY, {"where": "", "cause": "", "fix": ""}
    if isinstance(error, InputError):
        return Json({"error": error.document}, status)
    said = f"{error.strerror or error}." if isinstance(error, OSError) else str(error)
    if isinstance(error, RequestError):
        status = error.status
        told |= {"cause": error.cause, "fix": error.fix}
    code = status.phrase.lower().replace(" ", "-")
    return Json({"error": {"code": code, "message": said, **told}}, status)


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


# Who may ask the studio: browsers that were given one of its addresses, and nobody else.

PAGE_RULES = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self';"
    " frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
)
"""What the page may load: only what this server gives."""
DOCUMENT_RULES = (
    f"default-src 'none'; style-src 'unsafe-inline'; img-src data:; script-src {script_rule('live.js')};"
    " sandbox allow-popups allow-scripts"
)
"""What a report may do: show itself, and run our script that draws its plots, apart from the page."""
RULES = {
    "content-security-policy": PAGE_RULES,
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "cache-control": "no-store",
    "cross-origin-resource-policy": "same-origin",
    "cross-origin-opener-policy": "same-origin",
}


class Sessions:
    """Tokens, each of which opens one session, and the sessions that are open.

    - A token is in an address, and is good once. Where a used one comes again, `said` gets another, so that
      those who see the terminal can go on.
    - The secret of a session is kept by the page, which sends it as a header. No cookie is set: a browser
      sends those of 127.0.0.1 to every port of it, and another user's server may listen there.
    - A link to a file cannot have a header. Its address holds a key that is good for this file alone,
      because a page that a stranger wrote can tell its own address to where its links lead.

    **Arguments:**

    - `said`: gets every token that can be used.
    """

    def __init__(self, said: Callable[[str], None]):
        self._said = said
        self._used: set[str] = set()
        self._open: set[str] = set()
        self._key = secrets.token_bytes(32)
        self._new_token()

    def _new_token(self) -> None:
        self._token: str | None = secrets.token_urlsafe(24)
        self._said(self._token)

    @property
    def waiting(self) -> bool:
        """Whether the last token has not been used."""
        return self._token is not None

    def enter(self, token: str) -> str:
        """The secret of a new session. Raises `RequestError` for a token that is not good."""
        if self._token is not None and _same(token, self._token):
            self._used.add(self._token)
            self._token = None
            secret = secrets.token_urlsafe(24)
            self._open.add(secret)
            return secret
        if self._token is None and any(_same(token, used) for used in self._used):
            self._new_token()
        raise no_session()

    def has(self, secret: str) -> bool:
        """Whether this is the secret of a session."""
        return any(_same(secret, one) for one in self._open)

    def link(self, name: str) -> str:
        """The address of a file of the folder, below that of the page."""
        return f"files/{quote(name, errors='replace')}?key={self._key_of(name)}"

    def opens(self, name: str, key: str) -> bool:
        """Whether this is the key of a file."""
        return _same(key, self._key_of(name))

    def _key_of(self, name: str) -> str:
        return hmac.new(self._key, name.encode("utf-8", "replace"), hashlib.sha256).hexdigest()


class Guard:
    """ASGI middleware: the host as it is printed, a page of this origin, a session or the key of a file.

    - A page elsewhere cannot send requests here: its origin differs, and it cannot set `X-Hysid`.
    - A name that leads to 127.0.0.1 (DNS rebinding, or ::1 behind `localhost`) is refused.
    - Without a session there is only what every copy of hysid holds: the page and its scripts.
    """

    def __init__(self, app: Any, sessions: Sessions, host: str):
        self._app = app
        self._sessions = sessions
        self._host = host

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        async def ruled(message: Any) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in RULES.items():
                    headers.setdefault(name, value)
            await send(message)

        try:
            self._check(Request(scope))
        except RequestError as error:
            await refusal(error)(scope, receive, ruled)
            return
        await self._app(scope, receive, ruled)

    def _check(self, request: Request) -> None:
        """Raise `RequestError` for a request from elsewhere, and for one without a session."""
        path, head = request.scope["path"], request.headers
        page = path == "/" and request.method in ("GET", "HEAD")
        sites = {*head.getlist("sec-fetch-site")} - {"same-origin", "none"}
        origins = {*head.getlist("origin")} - {f"http://{self._host}"}
        if head.getlist("host") != [self._host] or origins or (sites and not page):
            said = "This request comes from another address than the studio's."
            raise RequestError(
                HTTPStatus.FORBIDDEN, said, fix=f"Open http://{self._host}, by this name."
            )
        if "\0" in path:  # earlier versions of Starlette look for such a file
            raise RequestError(HTTPStatus.NOT_FOUND, "There is nothing at this address.")
        if page or path.startswith("/static/") or path == "/api/enter":
            return
        key, secret = request.query_params.get("key", ""), head.get("x-hysid", "")
        if path.startswith("/files/"):
            known = self._sessions.opens(path.removeprefix("/files/"), key)
        else:
            known = self._sessions.has(secret)
        if not known:
            raise no_session()


def no_session() -> RequestError:
    """What is said to a browser that has no session, or to one whose link is of an earlier studio."""
    return RequestError(
        HTTPStatus.FORBIDDEN, "This browser has no session with hysid studio.",
        cause="The studio was started again, or the address was opened before: each works once.",
        fix="Open the last address that hysid studio has printed in its terminal. Opening one that was used"
        " makes it print another.",
    )  # fmt: skip


def _same(given: str, known: str) -> bool:
    return hmac.compare_digest(given.encode("utf-8", "replace"), known.encode())
