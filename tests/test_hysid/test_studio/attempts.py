"""Changes side by side, and what somebody at another port of this machine can use."""

import threading
import tomllib
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from hysid.studio._server import Prepared

from .served import ask, entered

TAKE = """async ([address, token]) => {
  const taken = [];
  const asks = { state: ["api/state", {}], page: ["", {}], script: ["static/page.js", {}],
    enter: ["api/enter", { method: "POST", body: JSON.stringify({ token }) }] };
  for (const [name, [path, how]] of Object.entries(asks))
    for (const mode of ["cors", "no-cors"])
      try {
        const answer = await fetch(address + path, { ...how, mode, credentials: "include" });
        if ((await answer.text()).length) taken.push(`${name} by ${mode}`);
      } catch { /* refused, as it should be */ }
  return [...taken, ...Object.values(localStorage), ...document.cookie.split(";").filter(Boolean)];
}"""
"""What a page of another port can read of the studio, and what its browser keeps for it."""


def lost_changes(ready: Prepared, secret: str, count: int = 50) -> int:
    """Of so many rows of `run.csv`, each left out at the same time: how many have not been."""

    def change(k: int) -> None:
        asked = {"name": "run.csv", "action": "exclude", "low": 12 * k - 1, "high": 12 * k + 1}
        for path in ("/api/look", "/api/brush"):  # the first look of all makes the configuration
            ask(ready.address, path, asked, X_Hysid=secret)

    with ThreadPoolExecutor(count) as pool:
        list(pool.map(change, range(count)))
    kept = tomllib.loads((ready.studio.folder.root / "run.toml").read_text("utf-8"))["selection"]
    return count - len(kept["exclude_lines"])


def usable_elsewhere(ready: Prepared, browser: Any = None) -> list[str]:
    """Ways that lead into the studio from another port, by what its server is sent or what its page does.

    `browser`: one of Playwright's, for what a browser sends; without one, what is told here is tried alone.
    """
    host, port = urlsplit(ready.address).netloc, urlsplit(ready.address).port
    token = urlsplit(ready.address).query.removeprefix("token=")
    found: list[str] = []
    if browser is None:
        secret = entered(ready.address)
    else:
        with _listening() as (other, heard):
            context = browser.new_context()
            page = context.new_page()
            page.goto(ready.address)
            page.get_by_role("heading").first.wait_for()
            secret = page.evaluate("localStorage.getItem('session')")
            assert ask(ready.address, "/api/state", X_Hysid=secret).status == 200
            guest = context.new_page()
            guest.goto(f"http://{other}/api/state?key=x")
            found += guest.evaluate(TAKE, [f"http://{host}/", token])
            context.close()
        assert heard
        for headers in heard:
            given = {name: value for name, value in headers.items() if name.lower() != "host"}
            found += [
                f"the headers of {path}" for path in ("/api/state", "/files/run.csv")
                if ask(ready.address, path, **given).status != 403
            ]  # fmt: skip
            found += [f"{what} is sent" for what in (secret, token) if what in str(headers)]
    ways = {
        "the token again": ask(ready.address, "/api/enter", {"token": token}),
        "the token as a session": ask(ready.address, "/api/state", X_Hysid=token),
        "the session as a cookie": ask(ready.address, "/api/state", Cookie=f"session={secret}"),
        "the session as a token": ask(ready.address, "/api/enter", {"token": secret}),
        "the session as a key": ask(ready.address, f"/files/run.csv?key={secret}"),
        "another origin": ask(ready.address, "/api/state", X_Hysid=secret, Origin="http://127.0.0.1:1"),
        "no origin": ask(ready.address, "/api/state", X_Hysid=secret, Origin="null"),
        "another port": ask(ready.address, "/api/state", X_Hysid=secret, Sec_Fetch_Site="same-site"),
        "another name": ask(ready.address, "/api/state", X_Hysid=secret, Host=f"localhost:{port}"),
    }  # fmt: skip
    return found + [way for way, answer in ways.items() if answer.status != 403]


@contextmanager
def _listening() -> Iterator[tuple[str, list[dict[str, str]]]]:
    """A server at another port, and the headers of what it is sent."""
    heard: list[dict[str, str]] = []

    class Curious(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            heard.append(dict(self.headers.items()))
            self.send_response(200)
            self.send_header("content-type", "text/html")
            self.end_headers()
            self.wfile.write(b"<h1>Another page</h1>")

        def log_message(self, *_: Any) -> None:
            """Say nothing."""

    server = HTTPServer(("127.0.0.1", 0), Curious)
    thread = threading.Thread(target=server.serve_forever, args=(0.01,))
    thread.start()
    try:
        yield f"127.0.0.1:{server.server_port}", heard
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


def snapshot(folder: Path) -> dict[str, tuple[int, bytes]]:
    """Every file below a folder, with its time and what it holds."""
    return {
        file.relative_to(folder).as_posix(): (file.stat().st_mtime_ns, file.read_bytes())
        for file in sorted(folder.rglob("*")) if file.is_file()
    }  # fmt: skip
