"""Who may ask the studio: browsers that were given one of its addresses, and nobody else."""

import hashlib
import hmac
import secrets
from collections.abc import Callable
from http import HTTPStatus
from typing import Any
from urllib.parse import quote

from starlette.datastructures import MutableHeaders
from starlette.requests import Request

from .._plots_script import script_rule
from ._requests import RequestError, refusal

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
      whoever sees the terminal can go on.
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
