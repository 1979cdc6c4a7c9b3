"""Options from a TOML file: the names are those of the command line, whose values override the file."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer
from typer.core import TyperCommand

from hysteresis import InputError
from hysteresis._escape import shell_word

from ..commands._asked import as_fields
from ..commands._console import log, start_jax
from ..intake._selection_options import FIELDS, HELD_OUT

if TYPE_CHECKING:
    from typer import Context
else:
    Context = typer.Context.__bases__[0]  # what typer hands to a callback is not of its own type

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
