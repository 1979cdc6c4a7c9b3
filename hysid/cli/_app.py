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
from ..commands import _asked, _asked_more
from ..commands._console import INTERRUPTED, USER, Fault, example, explain, stop
from ._config_file import FindsConfig
from ._options import command_of
from ._remedies import options_here

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
    _asked.Demo: "hysid demo --out demo",
    _asked.Init: "hysid init run.csv",
    _asked.Check: f"hysid check run.csv {SPONGE}",
    _asked_more.Loops: f"hysid loops run.csv {SPONGE}",
    _asked_more.Distortion: "hysid distortion run.csv --input u --output y --time t --group run",
    _asked_more.Datasheet: f"hysid datasheet run.csv {SPONGE}",
    _asked.Fit: f"hysid fit run.csv {SPONGE} --test-cycles 1 --out sponge",
    _asked.Predict: "hysid predict sponge new.csv --inverse",
    _asked.Qualify: "hysid qualify sponge new.csv --max-error 2 --rate 1000",
    _asked.Monitor: "hysid monitor sponge log.csv",
    _asked.Export: "hysid export sponge --c sponge.h --runtime sponge.json",
    _asked.Sample: "hysid sample sponge --ensembles 4",
    _asked.Design: "hysid design damper --max-displacement 2e-3",
    _asked.Compare: "hysid compare sponge foam",
    _asked.Report: "hysid report sponge",
    _asked.Batch: "hysid batch 'data/*.csv' --config sponge.toml --out all",
    _asked_more.Studio: "hysid studio run.csv",
    _asked.Reproduce: "hysid reproduce tsuji2014 --out tsuji2014",
    _asked.Warm: "hysid warm sponge",
}.items():
    _class = FindsConfig if "config" in _command.__dataclass_fields__ else None
    app.command(epilog=example(_example), cls=_class)(command_of(_command))
for _name, _about, _commands_of in (
    (
        "armor",
        "Contacts on a robot's armor: calibrate, solve, look at them.",
        {
            _asked_more.Calibrate: "hysid armor calibrate presses.csv --sponge sponge"
            " --shape box.toml --out armor",
            _asked_more.Solve: "hysid armor solve wrenches.csv --sponge sponge --shape box.toml"
            " --out touches",
            _asked_more.View: "hysid armor view touches",
        },
    ),
    (
        "microchannel",
        "Soft sensors: train one, estimate force and place.",
        {
            _asked_more.Train: "hysid microchannel train run.csv --input 'layer 1 (V)'"
            " --force 'force (N)' --time 'time (s)' --test-tail 0.2 --out sensor",
            _asked_more.TrainPairs: "hysid microchannel train-pairs run.csv --input 'layer 1 (V)'"
            " --input 'layer 2 (V)' --force 'force B (N)' --force 'force D (N)' --time 'time (s)'"
            " --group session --out pair",
            _asked_more.Estimate: "hysid microchannel estimate sensor new.csv",
        },
    ),
    (
        "datasets",
        "Data sets by third parties: list and download them.",
        {
            _asked_more.List: "hysid datasets list",
            _asked_more.Fetch: "hysid datasets fetch steel-coupon --out steel",
        },
    ),
):
    _group = typer.Typer(help=_about, no_args_is_help=True)
    for _command, _example in _commands_of.items():
        _group.command(epilog=example(_example))(command_of(_command))
    app.add_typer(_group, name=_name)


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
