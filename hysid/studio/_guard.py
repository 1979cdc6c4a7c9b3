"""Who may ask the studio: pages of its own address that have its token, and nobody else."""

import hmac
import secrets
from collections.abc import Awaitable, Callable
from typing import Any

from starlette.requests import Request
from starlette.responses import PlainTextResponse, RedirectResponse, Response

PAGE_RULES = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self';"
    " frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
)
"""What the page may load: only what this server gives."""
DOCUMENT_RULES = (
    "default-src 'none'; style-src 'unsafe-inline'; img-src data:; sandbox allow-popups"
)
"""What a report may do: show itself."""


class Guard:
    """ASGI middleware: the token once in the address, then in a cookie of this port; the host by its name.

    - A page elsewhere cannot send requests here: its origin differs, and it cannot set `X-Hysid`.
    - A name that leads to 127.0.0.1 (DNS rebinding) is refused, because the host is checked.
    """

    def __init__(self, app: Any, token: str, port: int):
        self._app = app
        self._token = token
        self._cookie = f"hysid-{port}"
        self._hosts = {f"127.0.0.1:{port}", f"localhost:{port}"}

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        request = Request(scope, receive)
        answer = self._refused(request) or self._entered(request)
        if answer is not None:
            _with_rules(answer)
            await answer(scope, receive, send)
            return
        await self._app(scope, receive, _adding_rules(send))

    def _refused(self, request: Request) -> Response | None:
        host = request.headers.get("host", "")
        origin = request.headers.get("origin")
        if host not in self._hosts or (origin is not None and origin != f"http://{host}"):
            return PlainTextResponse("This address is not the studio's.", 403)
        if request.method not in ("GET", "HEAD") and request.headers.get("x-hysid") != "1":
            return PlainTextResponse("This request is not the page's.", 403)
        return None

    def _entered(self, request: Request) -> Response | None:
        given = request.query_params.get("token")
        if given is not None and self._is_token(given):
            answer = RedirectResponse("/", 303)
            answer.set_cookie(self._cookie, self._token, httponly=True, samesite="strict", path="/")
            return answer
        if self._is_token(request.cookies.get(self._cookie, "")):
            return None
        said = "Open the address that hysid studio has printed: it holds the token of this studio."
        return PlainTextResponse(said, 403)

    def _is_token(self, given: str) -> bool:
        return hmac.compare_digest(given.encode(), self._token.encode())


def new_token() -> str:
    """A token that nobody can guess."""
    return secrets.token_urlsafe(24)


def _with_rules(answer: Response) -> None:
    for name, value in _rules().items():
        answer.headers.setdefault(name, value)


def _rules() -> dict[str, str]:
    return {
        "content-security-policy": PAGE_RULES,
        "x-content-type-options": "nosniff",
        "referrer-policy": "no-referrer",
        "cache-control": "no-store",
        "cross-origin-resource-policy": "same-origin",
        "cross-origin-opener-policy": "same-origin",
    }


def _adding_rules(send: Callable[[Any], Awaitable[None]]) -> Callable[[Any], Awaitable[None]]:
    async def wrapped(message: Any) -> None:
        if message["type"] == "http.response.start":
            headers = list(message.get("headers", []))
            there = {name.lower() for name, _ in headers}
            headers += [
                (name.encode(), value.encode())
                for name, value in _rules().items()
                if name.encode() not in there
            ]
            message = message | {"headers": headers}
        await send(message)

    return wrapped
