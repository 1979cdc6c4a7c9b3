"""The options of a command, made from the fields of what it is asked for."""

import inspect
from collections.abc import Callable
from dataclasses import MISSING, Field, fields
from pathlib import Path
from typing import Annotated, Any

import typer

from ..commands._asked import Command, Fit, as_fields, fields_of
from ..commands._console import print_result, start_jax
from ..intake._selection_options import FIELDS
from ._config_file import configure


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
    from hysteresis import InputError  # late: a foreign package of that name is said before

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
        kind, default = str, ""
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
