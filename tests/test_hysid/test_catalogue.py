"""`hysid datasets`: what the shipped catalogue says, and files fetched from a server of our own."""

import csv
import hashlib
import json
import threading
import tomllib
from collections.abc import Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest

from hysid._catalogue import SYNTHETIC
from tests.test_hysid.command import Result, answered, refused, run

SHIPPED = Path(__file__).parents[2] / "datasets" / "catalogue.toml"
CATALOGUE = tomllib.loads(SHIPPED.read_text("utf-8"))["dataset"]
LICENCES = {"", "MIT", "Apache-2.0", "BSD-3-Clause", "GPL-3.0"}


class Quiet(SimpleHTTPRequestHandler):
    def log_message(self, format: str, *args: Any) -> None:
        pass


@pytest.fixture
def address(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """Of a server of the folder `served`; the present folder is another one."""
    served = tmp_path / "served"
    served.mkdir()
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    monkeypatch.setenv("NO_PROXY", "127.0.0.1")
    with ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=str(served))) as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.01,))
        thread.start()
        yield f"http://127.0.0.1:{server.server_port}/"
        server.shutdown()
        thread.join()


def entry(address: str, content: str | bytes, **changes: Any) -> Path:
    """A catalogue of one data set, whose file is served. `changes` are of its file or its `read`."""
    content = content.encode() if isinstance(content, str) else content
    served = Path("../served") / "a run.csv"
    served.write_bytes(content)
    known = {"bytes": len(content), "sha256": hashlib.sha256(content).hexdigest()}
    file = {"path": served.name} | {k: changes.pop(k, v) for k, v in known.items()}
    columns = [
        {"name": "force (N)", "cell": 1},
        {"name": "gap (mm)", "cell": 0, "scale": -0.001, "zero": "first"},
    ]
    read = {"separator": ",", "cells": 2, "columns": columns} | changes
    catalogue = {
        "name": '"sponge"', "what": '"a “sponge”"', "page": '"there"', "base": f'"{address}"',
        "licence": '""', "citation": '"Them, 2020."', "notes": '["wet"]', "file": f"[{toml(file)}]",
        "read": toml(read), "fit": '{model = "LinearSponge", noise = "gaussian"}',
        "selection": '{input = "force (N)", output = "gap (mm)", dt = 0.1}',
    }  # fmt: skip
    text = "[[dataset]]\n" + "".join(f"{key} = {value}\n" for key, value in catalogue.items())
    Path("own.toml").write_text(text, encoding="utf-8")
    return Path("own.toml")


def tables(found: dict[str, Any]) -> str:
    return "".join(f"{key} = {toml(value)}\n" for key, value in found.items())


def toml(value: Any) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key} = {toml(x)}" for key, x in value.items()) + "}"
    if isinstance(value, list):
        return f"[{', '.join(map(toml, value))}]"
    return json.dumps(value)


def fetch(file: Path, *options: object, name: str = "sponge") -> Result:
    pytest.importorskip("pooch", reason="the extra hysid[datasets]")
    return run("datasets", "fetch", name, "--catalogue", file, "--out", "got", *options)


def rows(file: str = "got/sponge.csv") -> list[list[str]]:
    with open(file, newline="", encoding="utf-8") as page:
        return list(csv.reader(page))


def test_every_entry_says_where_and_under_which_licence():
    for dataset in CATALOGUE:
        assert dataset["licence"] in LICENCES
        assert dataset["page"].startswith("https://")
        # A branch moves; an address with a commit does not.
        assert any(len(part) == 40 and int(part, 16) for part in dataset["base"].split("/"))
        assert dataset["base"].endswith("/")
        assert dataset["citation"].endswith(".")
        for file in dataset["file"]:
            assert file["bytes"] > 0
            assert len(file["sha256"]) in (0, 64)
        labels = [file.get("label") for file in dataset["file"]]
        assert len({*labels}) == len(labels)


def test_the_catalogue_holds_no_measurements():
    assert SHIPPED.stat().st_size < 30_000
    assert all(len(dataset.get("notes", ())) < 6 for dataset in CATALOGUE)


@pytest.mark.parametrize("dataset", CATALOGUE, ids=lambda dataset: dataset["name"])
def test_configurations_are_what_fit_takes(dataset, tmp_path: Path):
    """Known keys and kinds, and columns that the CSV will have."""
    found, layout = dataset["selection"], dataset["read"]
    names = [column["name"] for column in layout["columns"]] + [layout.get("blocks", "")]
    names += ["file"] if len(dataset["file"]) > 1 else []
    there = {*names} - {""}
    config, file = tmp_path / "fit.toml", tmp_path / "run.csv"
    lines = [f"[{part}]\n{tables(dataset[part])}" for part in ("selection", "fit")]
    config.write_text("".join(lines), encoding="utf-8")
    file.write_text(",".join(f'"{name}"' for name in there) + "\n")
    # The file has its columns and no rows, which is told after all that may be wrong with options.
    refused(run("fit", file, "--config", config), "[no-rows]")
    said = [found[key] for key in ("input", "output", "time", "each") if key in found]
    said += found["group"].split(",") if "group" in found else []
    chosen = [w for k in ("where", "test_where") for w in found.get(k, ())]
    said += [w.split("=")[0].split("%")[0] for w in chosen]
    assert {*said} <= there


def test_list():
    shown = run("datasets", "list")
    listed = run("datasets", "list", "--json").json()["datasets"]
    assert [d["name"] for d in listed] == [d["name"] for d in CATALOGUE]
    for d in listed:
        (line,) = [line for line in shown.out.splitlines() if line.startswith(f"{d['name']} ")]
        assert d["what"] in line
        assert (d["licence"] or "none stated") in line
        assert ("*" in line) is not d["checked"]


def test_fetched_is_what_fit_takes(address: str):
    head = "gap,force\n(um),(N)\n\n"
    body = "".join(f"{5000 - 50 * min(k, 40 - k)},{min(k, 40 - k)}\n" for k in range(41))
    found = fetch(entry(address, head + body), "--json").json()
    assert found["rows"] == 41
    assert found["checked"]
    header, first, second, *_ = rows()
    assert (header, first, second) == (["force (N)", "gap (mm)"], ["0", "0"], ["1", "0.05"])
    config = Path(found["config"]).read_text("utf-8")
    assert found["sources"][0]["sha256"] in config
    assert "# Note: wet" in config
    assert tomllib.loads(config)["fit"] == {"model": "LinearSponge", "noise": "gaussian"}
    fitted = run("fit", found["file"], "--config", found["config"], "--out", "fit", "--json").json()
    assert fitted["model"] == "LinearSponge"


def test_nothing_is_written_over(address: str):
    file = entry(address, "1,2\n3,4\n")
    assert fetch(file).code == 0
    before = rows()
    entry(address, "1,2\n3,5\n")
    refused(fetch(file), "would-overwrite")
    assert rows() == before
    assert fetch(file, "--overwrite").code == 0
    assert rows() != before


@pytest.mark.parametrize("options", [(), ("--accept",)])
def test_other_bytes_than_listed_are_refused(address: str, options):
    listed = hashlib.sha256(b"1,2\n3,4\n").hexdigest()
    done = fetch(entry(address, "1,2\n3,5\n", sha256=listed), *options)
    answered(done, "wrong-checksum", listed)
    answered(fetch(entry(address, "1,2\n3,4\n", sha256="", bytes=7), *options), "wrong-checksum")
    assert not Path("got").exists()


def test_an_unknown_checksum_has_to_be_accepted(address: str):
    content = "1,2\n3,4\n"
    file, sha256 = entry(address, content, sha256=""), hashlib.sha256(content.encode()).hexdigest()
    answered(fetch(file), "unknown-checksum", sha256, "--accept")
    assert not Path("got").exists()
    found = fetch(file, "--accept", "--json").json()
    assert not found["checked"]
    assert sha256 in Path(found["config"]).read_text("utf-8")


def test_a_file_that_is_not_there(address: str):
    file = entry(address, "1,2\n")
    Path("../served/a run.csv").unlink()
    answered(fetch(file), "no-download", "404", "a%20run.csv")


def test_blocks_between_empty_lines_are_numbered(address: str):
    text = "Made by\r\n\r\n9,9\r\n\r\n1,10\r\n2,20\r\n\r\n9,9\r\n\r\n3,30\r\n4,40\r\n\r\nEnd of file\r\n"
    assert fetch(entry(address, text, blocks="curve")).code == 0
    assert [row[:2] for row in rows()] == [
        ["curve", "force (N)"], ["0", "10"], ["0", "20"], ["1", "30"], ["1", "40"],
    ]  # fmt: skip


def test_blanks_quotes_and_missing_readings(address: str):
    columns = [{"name": "y", "cell": 1, "missing": -1}]
    assert fetch(entry(address, " 1   2\n 3   -1\n", separator="", columns=columns)).code == 0
    assert rows() == [["y"], ["2"], [""]]
    file = entry(address, '\ufeff"1.50","2"\n', columns=[{"name": "y", "cell": 0}])
    assert fetch(file, "--overwrite").code == 0
    assert rows() == [["y"], ["1.50"]]


@pytest.mark.parametrize(
    ("text", "words"), [("1,2\nbroken\n3,4\n", "line 2"), ("a,b\n", "no line has 2 cells")]
)
def test_other_layouts_than_listed_are_refused(address: str, text: str, words: str):
    answered(fetch(entry(address, text)), "wrong-checksum", words)


@pytest.mark.parametrize("text", ["nothing", "[[dataset]]\nname = 'a'", "dataset = 3"])
def test_what_is_no_catalogue_is_said(tmp_path: Path, text: str):
    file = tmp_path / "own.toml"
    file.write_text(text)
    listed = run("datasets", "list", "--catalogue", file)
    refused(listed, "damaged-file", "no catalogue", "own.toml")
    refused(run("datasets", "list", "--catalogue", tmp_path / "no.toml"), "unreadable-file")


def test_columns_have_to_be_in_the_line(address: str):
    file = entry(address, "1,2\n", columns=[{"name": "y", "cell": 2}])
    refused(run("datasets", "list", "--catalogue", file), "damaged-file", "cell 2 of 2")
    file = entry(address, "1,2\n", columns=[{"name": "y", "cell": 1, "scale": "x"}])
    refused(run("datasets", "list", "--catalogue", file), "damaged-file", "text")


def test_an_unknown_name_finds_the_nearest():
    refused(run("datasets", "fetch", "steel-cupon"), "no-dataset", "steel-coupon")


def test_every_shipped_record_is_known_to_be_synthetic():
    files = sorted(SHIPPED.parent.glob("*.csv"))
    assert {hashlib.sha256(file.read_bytes()).hexdigest() for file in files} == SYNTHETIC
    for file in files:
        assert "**Synthetic.**" in file.with_suffix(".md").read_text(encoding="utf-8")
