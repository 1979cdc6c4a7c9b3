"""Who is answered by the studio, and what: sessions, wrong requests, changes side by side, links."""

import shutil
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from urllib.parse import quote, urlsplit

import pytest

from hysid.studio import _server
from hysteresis import InputError
from tests.refusals import raises
from tests.test_hysid.command import COLUMNS, ENVIRONMENT, LINE, SPONGE, run
from tests.test_hysid.test_studio.attempts import lost_changes, snapshot, usable_elsewhere
from tests.test_hysid.test_studio.malformed import READ, tried
from tests.test_hysid.test_studio.served import ask, entered, entering, serving, studio_of


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with `run.csv`."""
    found = tmp_path / "inner"
    found.mkdir()
    shutil.copy(SPONGE, found / "run.csv")
    return found


@pytest.fixture(scope="module")
def fit(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("fit") / "run"
    assert run("fit", SPONGE, *COLUMNS, *LINE, "--out", out).code == 0
    return out


@pytest.fixture
def fitted(folder: Path, fit: Path) -> Path:
    """A folder with `run.csv` and its fit."""
    shutil.copytree(fit, folder / "run")
    return folder


def test_a_wrong_request_is_answered_with_words(fitted):
    (fitted / "out").symlink_to(fitted.parent)
    (fitted / "loop").symlink_to(fitted / "loop")
    with serving([fitted]) as ready:
        found = tried(ready, 300)
    assert (found.faults, found.failed) == ([], 0)
    assert found.statuses[400] > found.statuses[200] > 10  # some are good all the same


@pytest.mark.thorough
def test_changes_at_the_same_time_all_arrive(folder):
    with serving([folder]) as ready:
        secret = entered(ready.address)
        # There is no configuration before the first of them.
        assert lost_changes(ready, secret) == 0
        look = ask(ready.address, "/api/look", {"name": "run.csv"}, X_Hysid=secret).document
    assert look["selection"]["input"] == "force (N)"


def test_nobody_at_another_port_can_use_what_opens_the_studio(folder):
    with serving([folder]) as ready:
        assert usable_elsewhere(ready) == []


def test_another_port_gets_nothing_from_a_browser_that_can_be_used(browser, folder):
    with serving([folder]) as ready:
        assert usable_elsewhere(ready, browser) == []


def test_an_address_opens_one_session_and_a_used_one_makes_another(folder):
    said: list[str] = []
    with serving([folder], said.append) as ready:
        assert said == [ready.address]
        token = urlsplit(ready.address).query.removeprefix("token=")
        assert ask(ready.address, "/api/enter", {"token": "wrong"}).status == 403
        # To look at it is not to use it.
        assert ask(ready.address, "/?token=" + token).status == 200
        secret = entered(ready.address)
        assert secret != token
        assert ask(ready.address, "/api/state", X_Hysid=secret).status == 200
        assert len(said) == 1
        for _ in range(3):  # one is waiting from the first time on
            refused = ask(ready.address, "/api/enter", {"token": token})
            assert refused.document["error"]["code"] == "forbidden"
            assert "makes it print another" in refused.document["error"]["fix"]
        assert len(said) == 2
        other = entered(said[1])
        for one in (secret, other):
            assert ask(ready.address, "/api/state", X_Hysid=one).status == 200


def test_the_token_is_in_no_arguments_and_only_the_user_reads_it(folder, tmp_path, monkeypatch):
    home, seen = tmp_path / "home", tmp_path / "seen"
    home.mkdir()
    script = tmp_path / "browser"
    script.write_text(
        f"#!{sys.executable}\nimport os, pathlib, shutil, sys, urllib.request\n"
        f"seen, file = pathlib.Path({str(seen)!r}), urllib.request.url2pathname(sys.argv[1][7:])\n"
        "modes = [oct(os.stat(p).st_mode & 0o777) for p in (file, os.path.dirname(file))]\n"
        "command = pathlib.Path('/proc', str(os.getppid()), 'cmdline')\n"
        "said = [*sys.argv, *modes, command.read_text() if command.exists() else '']\n"
        "shutil.copy(file, f'{seen}.html')\n"
        "seen.with_suffix('.new').write_text('\\n'.join(said))\n"
        "seen.with_suffix('.new').rename(seen)\n"
    )
    script.chmod(0o755)
    words = [sys.executable, "-m", "hysid", "studio", str(folder), "--json"]
    named = ENVIRONMENT | {"HOME": str(home), "BROWSER": f"{script} %s"}
    process = subprocess.Popen(words, env=named, stdout=subprocess.PIPE, text=True)
    try:
        address = process.stdout.readline().split('"')[3]
        token = urlsplit(address).query.removeprefix("token=")
        _wait_for(seen.exists)
        said = seen.read_text()
        assert token not in said
        assert said.split("\n")[2:4] == ["0o600", "0o700"]
        assert f"url={address}" in Path(f"{seen}.html").read_text()
        assert len(list(home.glob("hysid-studio-*"))) == 1
        entered(address)
        _wait_for(lambda: not list(home.glob("hysid-studio-*")))
    finally:
        process.terminate()
        process.communicate()


def test_the_file_that_opens_the_browser_leads_to_the_page(browser, folder, monkeypatch):
    seen: list[str] = []
    monkeypatch.setattr(_server.Path, "home", lambda: folder.parent)
    monkeypatch.setattr(_server.webbrowser, "open", lambda address: seen.append(address) or True)
    with serving([folder / "run.csv"]) as ready:
        thread = threading.Thread(target=_server.open_page, args=(ready,))
        thread.start()
        _wait_for(lambda: bool(seen))
        context = browser.new_context()
        page = context.new_page()
        page.goto(seen[0])
        page.get_by_role("heading", name="run.csv").wait_for()
        thread.join(10)
        assert not thread.is_alive()
        context.close()
    assert not list(folder.parent.glob("hysid-studio-*"))


def _wait_for(what: Callable[[], bool]) -> None:
    """Wait until it is so, for at most 30 s."""
    for _ in range(300):
        if what():
            return
        time.sleep(0.1)
    raise AssertionError("It did not come.")


def test_without_a_session_there_is_the_page_alone(folder):
    with serving([folder]) as ready:
        for path in ("/", "/static/page.js"):
            page = ask(ready.address, path)
            assert page.status == 200
            assert "script-src 'self'" in page.headers["content-security-policy"]
            assert "set-cookie" not in page.headers
        for name in ("look", "start", "upload", "redraw"):
            assert ask(ready.address, f"/api/{name}", {}).status == 403
        for name in READ:
            assert ask(ready.address, f"/api/{name}").status == 403
        for path in ("/files/run.csv", "/static/../api/state", "//api/state", "/api/state/", "/x"):
            assert ask(ready.address, path).status in (403, 404)
        assert ask(ready.address, "/", Host="evil.example").status == 403
        assert ask(ready.address, "/", {}, Origin="http://evil.example").status == 403


def test_a_link_is_good_for_its_file_alone(folder):
    (folder / "report.html").write_text("<script>1</script>")
    with entering(folder) as (ready, visit):
        report = visit("/api/link?name=report.html").document["address"]
        shown = ask(ready.address, f"/{report}")
        assert "sandbox" in shown.headers["content-security-policy"]
        taken = ask(ready.address, "/" + visit("/api/link?name=run.csv").document["address"])
        assert taken.body == SPONGE.read_bytes()
        assert "attachment" in taken.headers["content-disposition"]
        key = report.partition("?")[2]
        for path in (f"/files/run.csv?{key}", f"/files/report.html/?{key}", f"/api/state?{key}"):
            assert ask(ready.address, path).status == 403
        assert visit("/api/link?name=../x").status == 422


def test_get_changes_nothing_on_the_disk(fitted):
    (fitted / "run.toml").unlink(missing_ok=True)
    with entering(fitted) as (ready, visit):
        before = snapshot(fitted)
        query = "name=run.csv&first=2&last=9&value=&file=run.csv"
        for name in READ:
            assert visit(f"/api/{name}?{query}").status in (200, 422)
        link = visit("/api/link?name=run").document["address"]
        assert ask(ready.address, f"/{link}&download=1").body[:2] == b"PK"
        for name in ("look", "change", "again", "brush", "start", "compare", "upload"):
            assert visit(f"/api/{name}?{query}").status == 405
        assert snapshot(fitted) == before
        assert visit("/api/look", {"name": "run.csv"}).status == 200
    assert snapshot(fitted).keys() - before.keys() == {"run.toml"}


@pytest.mark.parametrize(
    "linked", ["run.csv", "run.toml", "run", "run/posterior.json", "run/fit.json"]
)
def test_links_that_lead_out_of_the_folder_are_not_read(fitted, linked):
    outside, place = fitted.parent / "outside", fitted / linked
    if place.exists():
        place.rename(outside)
    else:
        outside.write_text('[selection]\noutput = "SECRET"\n')
    place.symlink_to(outside)
    before = snapshot(fitted.parent)
    with entering(fitted) as (_, visit):
        state = visit("/api/state").document
        change, start = {"fit": {"seed": 1}}, {"kind": "report"}
        posts = {"look": {}, "change": change, "again": {}, "start": start}
        asks = [(name, {"name": "run.csv"} | body) for name, body in posts.items()]
        asks.append(("summary?name=run.csv", None))
        if linked != "run.toml":  # what needs no configuration
            assert [one["fit"] for one in state["files"]] in ([], [None])
            asks += [(f"{name}?name=run.csv", None) for name in ("curves", "posterior")]
            asks.append(("compare", {"names": ["run.csv"]}))
        for name, body in asks:
            answer = visit(f"/api/{name}", body)
            assert answer.document["error"]["code"] in ("outside-folder", "file-not-found"), name
        assert visit(f"/api/link?name={linked}").status == 422
    after = snapshot(fitted.parent)
    changed = {name for name in {*before, *after} if before.get(name) != after.get(name)}
    assert changed <= {f"inner/{name}" for name in ("run.toml", "run.toml.bak") if name != linked}
    assert place.is_symlink()


def test_every_configuration_is_kept_where_the_page_guesses_again(folder):
    texts = [f'# {k}\n[selection]\ninput = "force (N)"\n' for k in range(2)]
    with entering(folder) as (_, visit):
        for text in texts:
            (folder / "run.toml").write_text(text)
            visit("/api/again", {"name": "run.csv"})
    assert [(folder / f"run.toml.bak{k}").read_text() for k in ("", 1)] == texts


def test_a_configuration_names_no_dialects_outside_of_the_folder(folder):
    (folder.parent / "secret.toml").write_text("")
    with entering(folder) as (_, visit):
        asked = {"name": "run.csv", "selection": {"dialects": "../secret.toml"}}
        visit("/api/look", {"name": "run.csv"})
        assert visit("/api/change", asked).document["fault"]["code"] == "outside-folder"
        judged = visit("/api/judged?name=run.csv")
        assert judged.document["fault"]["code"] == "outside-folder"


def test_bodies_and_connections_have_limits(folder, monkeypatch):
    monkeypatch.setattr("hysid.studio._requests.PATIENCE", 0.3)
    monkeypatch.setattr(_server, "PATIENCE", 1.0)
    monkeypatch.setattr(_server, "MOST", 4)
    monkeypatch.setattr("hysid.studio._app.LARGEST", 1000)
    with entering(folder) as (ready, visit):
        host, port = urlsplit(ready.address).netloc.split(":")
        assert visit("/api/look", {"name": "x" * 2_000_000}).status == 413
        assert visit("/api/look", {"name": "x" * 2000}).status == 400
        assert visit("/api/upload?name=a.csv", "x" * 2000).status == 413
        assert not list(folder.glob("a*"))
        with socket.create_connection((host, int(port)), timeout=20) as slow:
            head = f"POST /api/enter HTTP/1.1\r\nHost: {host}:{port}\r\nContent-Length: 9\r\n\r\n"
            slow.sendall(head.encode())
            assert b" 408 " in slow.recv(4096)
        idle = [socket.create_connection((host, int(port)), timeout=20) for _ in range(5)]
        assert ask(ready.address, "/").status == 503
        assert [one.recv(10) for one in idle] == 5 * [b""]  # the studio has ended them
        assert ask(ready.address, "/").status == 200
        for one in idle:
            one.close()


def test_uploads_of_one_name_at_the_same_time_are_all_kept(folder):
    with entering(folder) as (_, visit):

        def upload(k: int) -> str:
            path = f"/api/upload?name={quote('漢' * 100)}.csv"
            return visit(path, "x" * (100_000 + k)).document["name"]

        with ThreadPoolExecutor(10) as pool:
            names = list(pool.map(upload, range(10)))
        assert len({*names}) == 10
        assert sorted((folder / name).stat().st_size - 100_002 for name in names) == list(range(10))


@pytest.mark.parametrize("value", ["..", "link/../outside", "/etc", "link", "\0", "a/" * 3000])
def test_no_value_of_a_fit_leads_out_of_the_folder(folder, value):
    (folder / "run").mkdir()
    (folder.parent / "outside").mkdir()
    (folder / "run" / "link").symlink_to(folder.parent / "outside")
    with studio_of(folder) as studio, pytest.raises((InputError, OSError)) as caught:
        studio.place("run.csv", value)
    assert getattr(caught.value, "code", "outside-folder") == "outside-folder"


def test_a_configuration_is_no_measurement(folder):
    (folder / "run.toml").write_text("[fit]\n")
    with studio_of(folder) as studio, raises("bad-option"):
        studio.look("run.toml")


def test_a_large_folder_is_not_packed(folder, monkeypatch):
    monkeypatch.setattr("hysid.studio._folder.LARGEST_ARCHIVE", 100)
    (folder / "large").mkdir()
    (folder / "large" / "it.csv").write_bytes(bytes(1000))
    with entering(folder) as (ready, visit):
        link = visit("/api/link?name=large").document["address"]
        answer = ask(ready.address, f"/{link}&download=1")
    assert "too large" in answer.document["error"]["message"]
