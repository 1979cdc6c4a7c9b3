"""Wrong requests of many kinds, and what a studio must answer them: words, and no failure of its own."""

import contextlib
import json
import random
import re
import socket
from collections import Counter
from typing import Any, NamedTuple
from urllib.parse import quote, urlsplit

from hysid.studio._server import Prepared
from hysteresis import InputError

from .served import ask, entered

FIELDS = {
    "look": ("name",), "judged": ("name",), "series": ("name", "low", "high", "box", "part"),
    "lines": ("name", "first", "last"), "change": ("name", "selection", "fit"), "again": ("name", "given"),
    "brush": ("name", "action", "low", "high", "box"), "cancel": ("number",), "compare": ("names",),
    "start": ("kind", "name", "value", "target", "file"), "curves": ("name", "value"),
    "redraw": ("name", "value", "values"), "posterior": ("name", "value"), "state": (),
    "summary": ("name", "value"), "written": ("name", "value", "file"), "link": ("name",),
    "enter": ("token",), "upload": ("name",), "nothing": ("name",),
}  # fmt: skip
"""The entries of each request of a page."""
READ = ("judged", "series", "lines", "curves", "posterior", "state", "summary", "written", "link")
GOOD: dict[str, Any] = {
    "name": "run.csv", "low": 0, "high": 100, "box": [0, 10, 0, 10], "part": "time", "first": 2, "last": 9,
    "selection": {"test_cycles": 2}, "fit": {"seed": 1}, "action": "exclude", "number": 1, "kind": "fit",
    "names": ["run.csv"], "value": "", "values": {"K": 1.0}, "file": "run.csv", "target": "", "token": "x",
    "given": {},
}  # fmt: skip
ODD: tuple[Any, ...] = (
    None, True, -1, 0, 10**9, 2**63, 10**400, 1e308, -0.0, float("nan"), float("inf"), "", " ", "x", "nan",
    "1e999", "\0", "\ud800", "\udcff.csv", "a" * 300, "é" * 200, "/" * 3000, "a/" * 2000, "z" * 100_000,
    "../../etc/passwd", "/etc/passwd", "..", ".", "run", "run.toml", "run.csv/x", "out", "loop",
    "run.csv\0", "%2e%2e", "C:\\x", "1,2,3", "1,2,3,x", "<b>", "'; --", [], {}, [None], [[[[]]]], {"a": 1},
    {"": None}, ["run.csv", 5], [1, 2, 3, float("nan")], {"K": "x"}, {"K": None}, {"__class__": 1.0},
    {"K.x.0": 1e308}, {"input": 5}, {"input": []}, {"units_row": -1}, {"table": 0}, {"range": [1, 2, 3]},
    {"nope": 1}, {"test_lines": ["x"]}, {"dialects": "../x.toml"}, {"dialects": "run.toml"},
    {"time": "\ud800"}, {"where": ["x"]}, {"test_tail": 1e308}, {"dt": -1}, {"nan": "x"},
    {"a\nb": {"c": []}}, {"a\nb": 1}, {"a.b": 1}, {'"\\': "\x00\x7f\u2028"}, {"": 1}, {"seed": 10**30},
    {"decimal": ";"}, {"na_values": "x" * 2000}, {"step": 0}, {"hold": True},
    {"exclude_lines": ["2-9" * 300]}, {"each": "time (s)"},
    {"exclude_lines": [f"{2 * k}-{2 * k}" for k in range(2000)]},
)  # fmt: skip
BODIES = (
    b"", b"{", b"[]", b"null", b"5", b'"x"', b"[" * 100_000, b'{"a":' * 5000, b"\xff\xfe{\x00}\x00",
    b"\xff", "{}".encode("utf-16"), "{}".encode("utf-32"), b'{"name": "\\ud800"}', b'{"name": NaN}',
    b'{"name": 1e999}', b'{"name": ' + b"9" * 5000 + b"}", b'{"a":1}' * 2, b"\x00" * 100, b" " * 1_100_000,
    b'{"name":"\xc3("}', b'{"name": "x", "name": 5}',
    b"--x\r\nContent-Disposition: form-data; name=a\r\n\r\n1\r\n--x--\r\n",
)  # fmt: skip
PATHS = (
    "/files/..%2f..%2fetc%2fpasswd", "/files/%00", "/files/%ff", "/files/", "/files/run.csv/",
    "/files/out", "/files/run.csv?key=x", "/files//etc/passwd", "/files/" + "a" * 5000,
    "/files/" + "a/" * 3000, "/files/%ed%a0%80", "/static/", "/static/%00", "/static/..%2f_app.py",
    "/static/../_app.py", "/static", "/static/" + "a" * 3000, "/static/%ff.js", "/static//etc/passwd",
    "//", "//api/state", "/api", "/api/", "/api/state/", "/API/STATE", "/api/state;x=1", "/api/state#x",
    "/api/%73tate", "/?token=%00", "/?token", "/?%ff=%ff", "/%", "/%zz", "/?" + "a=1&" * 3000, "*",
    "http://evil.example/", "//evil.example/api/state", "/.well-known/x", "/index.html", "/\\..\\x",
    "/static/uplot", "/static/loop/x", "/api/look%00",
)  # fmt: skip
METHODS = (
    "GET", "POST", "PUT", "DELETE", "PATCH", "OPTIONS", "TRACE", "HEAD", "CONNECT", "get", "FOO", "A" * 50,
)  # fmt: skip
HEADERS = (
    "Range: bytes=", "Range: bytes=9-1", "Range: bytes=0-0,2-3,x", "Range: x", "Range: bytes=-" + "9" * 30,
    "If-Range: x", "If-None-Match: *", "If-Modified-Since: x", "If-Modified-Since: Thu, 99 Foo 0000",
    "Cookie: " + "a=b; " * 500, "Cookie: \xff=\xff", "Content-Type: \xff",
    "Content-Type: text/plain; charset=x", "Content-Encoding: gzip", "Accept-Encoding: \x01",
    "Upgrade: websocket\r\nConnection: Upgrade",
    "Upgrade: h2c\r\nConnection: Upgrade, HTTP2-Settings\r\nHTTP2-Settings: x", "Expect: 100-continue",
    "Expect: x", "Origin: null", "Origin: http://evil.example", "Sec-Fetch-Site: cross-site",
    "Host: evil.example", "Host: \xff", "X-Forwarded-For: x", "X-Forwarded-Host: evil.example",
    "X-Hysid: \xff", "X-Hysid: x", "X" * 3000 + ": y", "A: " + "b" * 70_000,
    "\r\n".join(f"A{k}: b" for k in range(2000)), "no colon", ": x", "A:\x00b", " folded: x",
    "Transfer-Encoding: gzip", "Content-Length: -1", "Content-Length: x",
    "Content-Length: 5\r\nContent-Length: 6", "Content-Length: " + "9" * 30,
    "Transfer-Encoding: chunked\r\nContent-Length: 2",
)  # fmt: skip
CODED = re.compile(rb"HTTP/1\.1 (\d{3}) ")


class Tried(NamedTuple):
    """How many requests were answered with which status, and those whose answer is a fault."""

    statuses: Counter[int]
    faults: list[str]

    @property
    def failed(self) -> int:
        """Answers of a status 500 and above."""
        return sum(count for status, count in self.statuses.items() if status >= 500)


def tried(ready: Prepared, count: int, first: int = 0) -> Tried:
    """Send so many wrong requests to a studio of `run.csv`, which has a fit `run`; no command is begun.

    A fault is a status 500, an answer without words, or none at all.
    """

    def refused(*_: object) -> None:
        raise InputError("would-overwrite", "No command is begun here.")

    ready.studio.jobs.start = refused  # type: ignore[assignment]
    secret, host = entered(ready.address), urlsplit(ready.address).netloc
    made, found = random.Random(first), Tried(Counter(), [])
    for _ in range(count):
        request, whole = _request(made, host, secret)
        status, said = _answered(host, request, 60.0 if whole else 0.3)
        found.statuses[status] += 1
        if status >= 500 or (status >= 400 and not said) or (not status and whole):
            found.faults.append(f"{status} {said} {request[:600]!r}")
    assert ask(ready.address, "/api/state", X_Hysid=secret).status == 200
    look = ask(ready.address, "/api/look", {"name": "run.csv"}, X_Hysid=secret).document
    if (look["fault"] or {}).get("code") == "bad-config":  # none may leave a file that is not TOML
        found.faults.append(str(look["fault"]))
    return found


def _request(made: random.Random, host: str, secret: str) -> tuple[bytes, bool]:
    """A request, and whether it is one that has an answer."""
    name = made.choice([*FIELDS])
    method, path, body, lines = "POST", f"/api/{name}", b"", list[str]()
    kind = made.randrange(6)
    asked = {key: GOOD[key] for key in FIELDS[name]}
    if kind <= 2:  # entries of another kind, missing or not asked for
        entries = [*asked, "more"]
        for key in made.sample(entries, 1 if kind else made.randint(1, len(entries))):
            if made.random() < 0.2:
                asked.pop(key, None)
            else:
                asked[key] = made.choice(ODD)
        if (name in (*READ, "upload")) != (made.random() < 0.05):
            words = {
                key: value if isinstance(value, str) else json.dumps(value)
                for key, value in asked.items()
            }
            pairs = [f"{key}={quote(w[:9000], errors='replace')}" for key, w in words.items()]
            query = "&".join(pairs)
            method, path = ("POST" if name == "upload" else "GET"), f"{path}?{query}"
        else:
            body = json.dumps(asked).encode()
    elif kind == 3:
        body = made.choice((*BODIES, made.randbytes(50)))
    elif kind == 4:
        method, path = made.choice(("GET", "POST", "HEAD")), made.choice(PATHS)
    else:
        method, lines = made.choice(METHODS), [made.choice(HEADERS)]
        path = made.choice((path, "/", "/static/page.js", "/files/run.csv"))
        body = json.dumps(asked).encode() if made.random() < 0.5 else b""
    if made.random() < 0.95:
        lines.append(f"X-Hysid: {secret}")
    if made.random() < 0.97:
        lines.append(f"Host: {host}")
    if made.random() < 0.97:
        lines.append(f"Content-Length: {len(body)}")
    lines.append("Connection: close")
    head = f"{method} {path} HTTP/1.1\r\n" + "".join(f"{line}\r\n" for line in lines)
    said = "".join(lines).lower()
    whole = "transfer-encoding" not in said and said.count("content-length") < 2
    return head.encode("latin-1", "replace") + b"\r\n" + body, whole


def _answered(host: str, request: bytes, patience: float) -> tuple[int, str]:
    """Status and words of the answer; 0 where there is none in so many seconds."""
    name, _, port = host.partition(":")
    with socket.create_connection((name, int(port)), timeout=patience) as opened:
        found = b""
        with contextlib.suppress(ConnectionError):  # it may answer before it was told everything
            opened.sendall(request)
        with contextlib.suppress(ConnectionError, TimeoutError):
            while piece := opened.recv(65536):
                found += piece
    status = 0
    for coded in CODED.finditer(found):
        status = int(coded[1])
    body = found.rpartition(b"\r\n\r\n")[2]
    if request.startswith(b"HEAD"):
        return status, "HEAD"
    try:
        return status, json.loads(body)["error"]["message"] if body.startswith(
            b"{"
        ) else body.decode()[:200]
    except (ValueError, KeyError, TypeError):
        return status, ""
