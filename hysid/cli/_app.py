"""The command line: its commands, and how a run ends."""

import gc
import signal
import sys
import threading
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from io import TextIOWrapper
from typing import Annotated, Any

import typer

from .._packages import fault_of_packages
from ._armor import armor
from ._batch import batch
from ._bench import bench
from ._compare import compare
from ._config_file import FindsConfig
from ._console import INTERRUPTED, USER, Fault, example, explain, stop
from ._datasets import datasets
from ._demo import demo
from ._export import export
from ._fit import fit
from ._inspect import check, init
from ._microchannel import microchannel
from ._new_data import monitor, predict, qualify
from ._remedies import options_here
from ._report import report
from ._reproduce import reproduce
from ._sample import design, sample
from ._studio import studio
from ._warm import warm

SPONGE = "--input 'force (N)' --output 'displacement (mm)' --time 'time (s)'"

app = typer.Typer(
    help="Fit hysteresis models to test-rig data and run them backwards as compensators.\n\n"
    "Begin with a file of your rig that has an input, an output and the time:\n\n\b\n"
    "  hysid fit run.csv             the best model, and whether it can be trusted\n"
    "  hysid report run              the same as a page with pictures\n"
    "  hysid export run --c run.h    its compensator for a controller",
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)

for _command, _example in {
    demo: "hysid demo --out demo",
    init: "hysid init run.csv",
    check: f"hysid check run.csv {SPONGE}",
    fit: f"hysid fit run.csv {SPONGE} --test-cycles 1 --out sponge",
    predict: "hysid predict sponge new.csv --inverse",
    qualify: "hysid qualify sponge new.csv --max-error 2 --rate 1000",
    monitor: "hysid monitor sponge log.csv",
    export: "hysid export sponge --c sponge.h --runtime sponge.json",
    sample: "hysid sample sponge --ensembles 4",
    design: "hysid design damper --max-displacement 2e-3",
    compare: "hysid compare sponge foam",
    report: "hysid report sponge",
    batch: "hysid batch 'data/*.csv' --config sponge.toml --out all",
    studio: "hysid studio run.csv",
    reproduce: "hysid reproduce tsuji2014 --out tsuji2014",
    warm: "hysid warm sponge",
    bench: "hysid bench preisach --quick",
}.items():
    _class = FindsConfig if _command in (check, fit) else None
    app.command(epilog=example(_example), cls=_class)(_command)
app.add_typer(armor, name="armor")
app.add_typer(microchannel, name="microchannel")
app.add_typer(datasets, name="datasets")


def _show_version(wanted: bool) -> bool:
    if not wanted:
        return False
    try:
        print(f"hysid {version('hysid')}")
    except PackageNotFoundError:
        print("hysid, not installed: run from its sources")
    raise typer.Exit


@app.callback()
def _hysid(
    version: Annotated[
        bool,
        typer.Option(
            "--version", is_eager=True, callback=_show_version, help="Show the version and exit."
        ),
    ] = False,
) -> None:
    """Options of hysid itself."""


@cache
def _commands() -> Any:
    """All commands; made once, because typer looks at every signature, which takes 40 ms."""
    return typer.main.get_command(app)


def _terminated(*_: object) -> None:
    """SIGTERM ends a command as Ctrl-C does, which a terminal sends to our processes too."""
    import multiprocessing  # late: most commands start no process

    for process in multiprocessing.active_children():
        process.terminate()
    raise KeyboardInterrupt


def main() -> None:
    """Run the command line: exit 0 good, 2 the user's data or settings are at fault, 1 a bug of hysid.

    An error is the last line on stderr: a sentence or, with `--json`, one JSON object.
    """
    arguments = sys.argv[1:] or ["--help"]
    # Tracing makes millions of small objects: Python would look for cycles among them 900 times in a fit.
    gc.set_threshold(20_000)
    as_json = "--json" in arguments
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):  # not where a program has put another one
            stream.reconfigure(errors="backslashreplace")
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGTERM, _terminated)
    if fault := fault_of_packages():
        stop(Fault("foreign-package", fault), fault, USER, as_json)
    try:
        code = _commands()(arguments, prog_name="hysid", standalone_mode=False)
    except (KeyboardInterrupt, typer.Abort):
        code = INTERRUPTED  # what newer typers return; older ones raise Abort
    except Exception as error:
        stop(*explain(options_here(error, _commands(), arguments)), as_json)
    if code == INTERRUPTED:
        said = "Interrupted. What was written so far is complete."
        stop(Fault("interrupted", said), said, INTERRUPTED, as_json)
