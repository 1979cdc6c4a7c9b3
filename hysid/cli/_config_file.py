"""Options from a TOML file: the names are those of the command line, whose values override the file."""

import inspect
from collections.abc import Mapping
from difflib import get_close_matches
from pathlib import Path
from types import NoneType
from typing import TYPE_CHECKING, Any, get_args, get_origin, get_type_hints

import typer
from typer.core import TyperCommand

from ..commands._asked import as_fields
from ..commands._console import log, start_jax
from ..intake._fit_options import FIT_FIELDS
from ..intake._selection_options import FIELDS, HELD_OUT

if TYPE_CHECKING:
    from typer import Context

    from hysteresis import InputError
else:
    Context = typer.Context.__bases__[0]  # what typer hands to a callback is not of its own type

SELECTION = tuple(FIELDS)
"""Options of `hysid fit` that choose rows and columns: the table [selection]. The others are in [fit]."""

NOT_HERE = ("file", "out", "config", "overwrite", "as_json", "kind", "csv", "files")
"""Options that only the command line has."""

INSTEAD = (HELD_OUT, ("time", "dt"))
"""Options of which one, given on the command line, replaces all of its group in a configuration."""
REPLACED = "hysid.replaced"

MOST_USED = (
    "file", "input", "output", "time", "config", "test_cycles", "test_tail", "model", "purpose",
    "parameter", "noise", "seed", "out",
)  # fmt: skip
"""What stands first in its group of a command's help."""

WORDS = {int: "a whole number", float: "a number", str: "text", bool: "true or false"}
JOINED = (
    *(name for name, one in (FIELDS | FIT_FIELDS).items() if one.metadata.get("joined")),
    "model",
)
"""Options that hold several words, separated by commas; a TOML file may also have a list."""


def read_config(file: Path, command: Any) -> dict[str, Any]:
    """The options in a file for a command, by the names of its parameters.

        [selection]
        input = "force (N)"
        output = "displacement (mm)"

        [fit]
        model = "Burgers"

        [parameters]
        E1 = {start = 2.0, bounds = [0.1, 100.0]}

    Selecting options that the command does not have are skipped: `hysid check` has no hold-out.

    Raises `InputError` for a file that does not exist or is not TOML, and for a table, a key or a kind of
    value that the command does not know.
    """
    from ..intake._own_config import read_toml  # late: it loads NumPy

    document = read_toml(file)
    hints = get_type_hints(inspect.unwrap(command.callback))
    known = {name: hint for name, hint in hints.items() if name not in NOT_HERE}
    tables = {
        "selection": [name for name in known if name in SELECTION],
        "fit": [name for name in known if name not in SELECTION],
    }
    found: dict[str, Any] = {}
    for table, values in document.items():
        if table == "file":  # what the configuration was written for
            continue
        if table not in (*tables, "parameters"):
            raise _unknown(file, f"[{table}]", table, [*tables, "parameters"], tables)
        if not isinstance(values, Mapping):
            raise _unknown(file, table, table, [], tables)
        if table == "parameters" or not tables[table]:  # a command that only looks fits nothing
            continue
        for key, value in values.items():
            if key in SELECTION and key not in known and table == "selection":
                continue
            if key not in tables[table]:
                raise _unknown(file, f"{key} in [{table}]", key, tables[table], tables)
            found[key] = _of_kind(file, key, value, known[key])
    return found


def _unknown(
    file: Path, what: str, key: str, there: list[str], tables: Mapping[str, list[str]]
) -> "InputError":
    """For an unknown key: name the nearest known one, or the table to which it belongs."""
    elsewhere = [table for table, names in tables.items() if key in names]
    near = get_close_matches(key.replace("-", "_"), there, 1, 0.5)
    if elsewhere:
        fix = f"Move it to the table [{elsewhere[0]}]."
    else:
        fix = f"Did you mean {near[0]}?" if near else f"Use one of {', '.join(there)}."
    return _error(
        "unknown-key", f"The configuration has an unknown entry: {what}.", place=str(file), fix=fix
    )


def _of_kind(file: Path, key: str, value: Any, hint: Any) -> Any:
    """A value as the command line has it: a list for an option that repeats, or words joined by commas."""
    (hint,) = [h for h in get_args(hint) or (hint,) if h is not NoneType]
    repeats = get_origin(hint) is list
    kind = str if repeats else hint
    kinds = (int, float) if kind is float else (kind,)
    listed = value if isinstance(value, list) else [value]
    one = not (repeats or key in JOINED)
    if (isinstance(value, list) and one) or any(type(x) not in kinds for x in listed):
        raise _error("bad-config", f"{key} = {value!r} is not {WORDS[kind]}.", place=str(file))
    return listed if repeats else ",".join(listed) if key in JOINED else value


def _error(code: str, problem: str, **words: str) -> "InputError":
    from hysteresis import InputError  # late: a foreign package of that name is said before

    return InputError(code, problem, **words)


def configure(context: Context, file: Any) -> Path | None:
    """The options in the file become the defaults of the command; read before its other options."""
    if file is None:
        return None
    file = Path(file)  # some typers give the text
    found = read_config(file, context.command)
    for name in context.meta.get(REPLACED, ()):
        found.pop(name, None)
    context.default_map = {**(context.default_map or {}), **found}
    return file


class FindsConfig(TyperCommand):
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
            group = "Data" if name in (*SELECTION, "file", "config") else group
            group = "Split" if name in (*HELD_OUT, "exclude_lines") else group
            if (record := one.get_help_record(ctx)) is not None:
                rows[group].append((record[0], record[1].replace("  [required]", "")))
        for group, records in rows.items():
            if records:
                with formatter.section(group):
                    formatter.write_dl(records)

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        given, _, _ = self.make_parser(ctx).parse_args(args=list(args))
        looked_at = not (given.get("help") or ctx.resilient_parsing)
        file = next(iter(given.get("files") or ()), given.get("file"))
        if looked_at and isinstance(file, str):
            ctx.meta[REPLACED] = [n for group in INSTEAD if {*group} & {*given} for n in group]
            if (config := self._own_config(ctx, Path(file), given)) is not None:
                args = ["--config", str(config), *args]
        return super().parse_args(ctx, args)

    def _own_config(self, ctx: Any, file: Path, given: Mapping[str, Any]) -> Path | None:
        """The configuration to add; looks at the file first, and says where it is not the one meant."""
        chosen = given.get("config")
        if chosen is None and {"input", "output", "step"} & {*given}:
            return None
        start_jax()
        from ..intake._own_config import check_there, compared, config_of  # after JAX is set up

        if chosen is not None:
            if file.exists() and (note := compared(Path(chosen), file, chosen=True)):
                log(f"Note: {note}")
            return None
        check_there(file)
        config = config_of(file)
        if config == file or not config.is_file():
            return self._begun(ctx, file, given)
        log(f"Options of {config}.")
        if note := compared(config, file, chosen=False):
            log(f"Note: {note}")
        return config

    def _begun(self, ctx: Any, file: Path, given: Mapping[str, Any]) -> Path | None:
        from hysteresis._escape import shell_word  # after JAX is set up

        from ..intake._init import begun

        if self.name not in ("fit", "loops", "datasheet"):
            raise _error(
                "cannot-decide",
                "No column is chosen, and the file has no configuration.",
                place=str(file),
                fix=f"Run hysid init {shell_word(str(file))}, or name them (--input COL --output COL).",
            )
        by_name = {one.name: one for one in self.params}
        said = {n: by_name[n].process_value(ctx, given[n]) for n in SELECTION if n in given}
        return begun(file, as_fields(said), log)


def options_of(file: Path, command: Any) -> dict[str, Any]:
    """All options of a command, as if it had been called with `--config FILE` alone.

    Raises `InputError` where the file has no output column.
    """
    if "output" not in read_config(file, command):
        raise _error(
            "bad-config",
            "The table [selection] has no output.",
            place=str(file),
            fix='Name its column: output = "displacement (mm)".',
        )
    context = command.context_class(command, info_name=command.name)
    TyperCommand.parse_args(command, context, ["FILE", "--out", "DIR", "--config", str(file)])
    # Of an option that may be repeated and is not given, typer hands None on.
    return {name: None if value == () else value for name, value in context.params.items()}
