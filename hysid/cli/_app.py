"""The command line: its commands, and how a run ends."""

import gc
import inspect
import re
import signal
import sys
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, Field, fields
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from io import TextIOWrapper
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperCommand

from hysteresis import InputError
from hysteresis._escape import shell_word

from ..commands import _asked, _asked_more
from ..commands._asked import Command, Fit, as_fields, fields_of
from ..commands._console import (
    INTERRUPTED,
    example,
    explain,
    fault,
    log,
    print_result,
    start_jax,
    stop,
)
from ..intake._options import ASIDE, FIELDS, HELD_OUT

if TYPE_CHECKING:
    from typer import Context
else:
    Context = typer.Context.__bases__[0]  # what typer hands to a callback is not of its own type


# Options from a TOML file: the names are those of the command line, whose values override the file.

INSTEAD = (HELD_OUT, ("time", "dt"))
"""Options of which one, given on the command line, replaces all of its group in a configuration."""
REPLACED = "hysid.replaced"

MOST_USED = (
    "file", "input", "output", "time", "config", "test_cycles", "test_tail", "model", "purpose",
    "parameter", "noise", "seed", "out",
)  # fmt: skip
"""What stands first in its group of a command's help."""


def configure(context: Context, file: Any) -> Path | None:
    """The options in the file become the defaults of the command; read before its other options."""
    if file is None:
        return None
    from ..intake._own_config import read_config  # late: it loads NumPy

    file = Path(file)  # some typers give the text
    tables, gone = read_config(file), context.meta.get(REPLACED, ())
    # `hysid check` has no hold-out.
    here = {one.name: one for one in context.command.params if one.name not in gone}
    found = {k: v for table in tables.values() for k, v in table.items() if k in here}
    for name, value in found.items():
        if isinstance(value, str) and getattr(here[name], "multiple", False):
            found[name] = [value]
    context.default_map = {**(context.default_map or {}), **found}
    return file


class EachOnce(TyperCommand):
    """A command that refuses an option that is given twice and takes one value: the first would be lost."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        given, _, order = self.make_parser(ctx).parse_args(args=list(args))
        for one in order:
            if order.count(one) > 1 and not (one.multiple or getattr(one, "is_flag", False)):
                raise typer.BadParameter("give it once", ctx=ctx, param_hint=repr(one.opts[0]))
        return super().parse_args(ctx, self.completed(ctx, args, given))

    def completed(self, ctx: Any, args: list[str], given: Mapping[str, Any]) -> list[str]:
        """The arguments, with what follows from those that are `given`, by the name of the option."""
        return args


class FindsConfig(EachOnce):
    """A command on FILE that takes the options of FILE's .toml where no column and no --config is given.

    `hysid fit` writes that .toml, as `hysid init` does, where it is not there and every role is sure.
    """

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Help in groups, in the order of a fit, what is used most first; without groups that are empty."""
        rows: dict[str, list[Any]] = {"Data": [], "Split": [], "Model": [], "Output": []}
        first = {name: place for place, name in enumerate(MOST_USED)}
        for one in sorted(self.get_params(ctx), key=lambda p: first.get(p.name or "", len(first))):
            name = one.name or ""
            group = "Output" if name in ("out", "overwrite", "as_json", "help") else "Model"
            group = "Data" if name in (*FIELDS, "file", "config") else group
            group = "Split" if name in (*HELD_OUT, "exclude_lines") else group
            if (record := one.get_help_record(ctx)) is not None:
                rows[group].append((record[0], record[1].replace("  [required]", "")))
        for group, records in rows.items():
            if records:
                with formatter.section(group):
                    formatter.write_dl(records)

    def completed(self, ctx: Any, args: list[str], given: Mapping[str, Any]) -> list[str]:
        looked_at = not (given.get("help") or ctx.resilient_parsing)
        file = next(iter(given.get("files") or ()), given.get("file"))
        if looked_at and isinstance(file, str):
            ctx.meta[REPLACED] = [n for group in INSTEAD if {*group} & {*given} for n in group]
            if (config := self._own_config(ctx, Path(file), given)) is not None:
                return ["--config", str(config), *args]
        return args

    def _own_config(self, ctx: Any, file: Path, given: Mapping[str, Any]) -> Path | None:
        """The configuration to add; looks at the file first, and says where it is not the one meant."""
        chosen = given.get("config")
        if chosen is None and {"input", "output", "step"} & {*given}:
            return None
        start_jax()
        from ..intake._own_config import check_there, compared, config_of, written_for

        if chosen is not None:
            if file.exists() and (note := compared(Path(chosen), file, chosen=True)):
                log(f"Note: {note}")
            return None
        check_there(file)
        config = config_of(file)
        if file.suffix == ".toml" and (name := str(written_for(file).get("name", ""))):
            raise InputError(
                "bad-option",
                "This file holds options, no readings.",
                place=str(file),
                fix=f"hysid {self.name} {shell_word(name)} --config {shell_word(str(file))}.",
            )
        if config == file or not config.is_file():
            return self._begun(ctx, file, given)
        log(f"Options of {config}.")
        if note := compared(config, file, chosen=False):
            log(f"Note: {note}")
        return config

    def _begun(self, ctx: Any, file: Path, given: Mapping[str, Any]) -> Path | None:
        from ..intake._init import begun  # after JAX is set up

        if self.name not in ("fit", "loops", "datasheet"):
            raise InputError(
                "cannot-decide",
                "No column is chosen, and the file has no configuration.",
                place=str(file),
                fix=f"Run hysid init {shell_word(str(file))}, or name them (--input COL --output COL).",
            )
        by_name = {one.name: one for one in self.params}
        said = {n: by_name[n].process_value(ctx, given[n]) for n in FIELDS if n in given}
        return begun(file, as_fields(said), log)


def command_of(asked: type[Command]) -> Callable[..., None]:
    """The function for typer that makes an `asked` of its options, has it done, and prints."""
    chosen: dict[str, inspect.Parameter] = {}
    known = {one.name: one for one in fields(asked)}
    for one in [*(one for one in known.values() if one.name != "as_json"), known["as_json"]]:
        for option in one.metadata.get("selection", ()):
            chosen[option] = _parameter(FIELDS[option], **one.metadata["how"])
        if "help" in one.metadata:
            chosen[one.name] = _parameter(one)

    def command(**values: Any) -> None:
        given = fields_of(asked, values)
        if "fit" in known:
            given["fit"] = fit_of(given["config"])
        found = asked(**given)  # says what is wrong before anything is loaded
        if found.jax:
            start_jax(double=not getattr(given.get("fit", found), "allow_float32", False))
        if (done := found.run()) is None:  # a page has been served
            return
        print_result(done.document, found.as_json, done.lines)
        if done.status:
            raise SystemExit(done.status)  # stdout says why; the command itself did not fail

    command.__name__, command.__doc__ = asked.title(), inspect.getdoc(asked)
    command.__signature__ = inspect.Signature([*chosen.values()])  # type: ignore[attr-defined]
    command.__annotations__ = {name: one.annotation for name, one in chosen.items()}
    return command


def fit_of(config: Path) -> Fit:
    """What `hysid fit --config FILE` is asked for, of a file that is named later."""
    from ..intake._own_config import read_config  # late: it loads NumPy

    tables = read_config(config)
    if "output" not in tables["selection"]:
        raise InputError(
            "bad-config",
            "The table [selection] has no output.",
            place=str(config),
            fix='Name its column: output = "displacement (mm)".',
        )
    given: dict[str, Any] = fields_of(Fit, tables["fit"] | {"file": Path("FILE"), "config": config})
    given["selection"] = as_fields(tables["selection"])
    return Fit(**given)


def _parameter(
    one: Field[Any], optional: bool = False, needs_input: bool = False
) -> inspect.Parameter:
    """One option or argument for typer."""
    said, kind, default = one.metadata, one.type, one.default
    if said.get("repeated"):
        needed = default is MISSING and (needs_input or one.name != "input")
        kind, default = (list[str], MISSING) if needed else (list[str] | None, None)
    elif said.get("joined"):
        kind, default = list[str] | None, None  # given twice, none is lost
    elif optional and kind is not bool:
        kind, default = kind | None, None  # type: ignore[operator]
    choices = said.get("choices", ())
    known: dict[str, Any] = {
        "help": said["help"], "metavar": said.get("metavar", "|".join(choices) or None),
        "min": said.get("least"), "max": said.get("most"), "show_default": said.get("show_default", True),
        "callback": _one_of(*choices) if choices else None,
    }  # fmt: skip
    if said.get("config"):
        known |= {"is_eager": True, "callback": configure}
    flag = said.get("flag", f"--{one.name.replace('_', '-')}")
    made = typer.Argument(**known) if said.get("argument") else typer.Option(flag, **known)
    return inspect.Parameter(
        one.name,
        inspect.Parameter.KEYWORD_ONLY,
        default=inspect.Parameter.empty if default is MISSING else default,
        annotation=Annotated[kind, made],
    )


def _one_of(*choices: str) -> Callable[[str | None], str | None]:
    """A check that an option is one of these words."""

    def check(value: str | None) -> str | None:
        if value is not None and value not in choices:
            raise typer.BadParameter(f"{value!r} is not {' or '.join(choices)}")
        return value

    return check


_OPTION = re.compile(r"(?<![\w-])--[a-z][a-z0-9-]+")
_COMMAND = re.compile(r"hysid [a-z]+(?:[^;,.)]|\.\w)*")


def options_here(error: Exception, root: Any, arguments: Sequence[str]) -> Exception:
    """The error with a remedy that this command has.

    Options in brackets that it lacks are left out; of others the command that has them is named.
    """
    fix = getattr(error, "fix", "")
    if not isinstance(fix, str) or "--" not in fix:
        return error
    command = root
    for word in arguments:
        if word not in getattr(command, "commands", {}):
            break
        command = command.commands[word]
    here = options_of_command(command)
    named = lambda text: set(_OPTION.findall(_COMMAND.sub("", text)))  # noqa: E731
    fix = ASIDE.sub(lambda m: m[0] if not named(m[0]) or named(m[0]) & here else "", fix)
    if lost := sorted(named(fix) - here):
        others = (one for one in root.commands.values() if options_of_command(one) >= set(lost))
        owner = next((one.name for one in others), "")
        fix += f" {', '.join(lost)}: see hysid {owner} --help." if owner else ""
    if fix == error.fix:  # type: ignore[attr-defined]
        return error
    assert isinstance(error, InputError)
    return InputError(error.code, error.problem, place=error.place, cause=error.cause, fix=fix)


def options_of_command(command: Any) -> set[str]:
    """The long options of a command."""
    names = (name for one in command.params for name in (*one.opts, *one.secondary_opts))
    return {name for name in names if name.startswith("--")}


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
    _class = FindsConfig if "config" in _command.__dataclass_fields__ else EachOnce
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
    _group = typer.Typer(help=_about)
    for _command, _example in _commands_of.items():
        _group.command(epilog=example(_example), cls=EachOnce)(command_of(_command))
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
    arguments = sys.argv[1:]
    if arguments in ([], *([one.name] for one in app.registered_groups)):
        arguments = [*arguments, "--help"]
    # Tracing makes millions of small objects: Python would look for cycles among them 900 times in a fit.
    gc.set_threshold(20_000)
    as_json = "--json" in arguments
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):  # not where a program has put another one
            stream.reconfigure(errors="backslashreplace")
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGTERM, _terminated)
    try:
        code = _commands()(arguments, prog_name="hysid", standalone_mode=False)
    except (KeyboardInterrupt, typer.Abort):
        code = INTERRUPTED  # what newer typers return; older ones raise Abort
    except Exception as error:
        stop(*explain(options_here(error, _commands(), arguments)), as_json)
    if code == INTERRUPTED:
        said = "Interrupted. What was written so far is complete."
        stop(fault("interrupted", said), said, INTERRUPTED, as_json)
