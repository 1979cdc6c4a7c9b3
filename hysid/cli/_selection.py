"""The selecting options of a command, made from the fields of `Selection`."""

import inspect
from collections.abc import Callable, Mapping
from dataclasses import MISSING
from functools import wraps
from typing import Annotated, Any

import typer

from ..intake._selection_options import FIELDS
from ._console import one_of


def takes_selection(
    *names: str, optional: bool = False, needs_input: bool = False
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Replace the parameter `selection` of a command by these options, or by all.

    The command gets them as one mapping, ready for `Selection(**selection)`.

    **Arguments:**

    - `optional`: nothing has a default, and only the options that were given are in the mapping.
    - `needs_input`: `--input` has to be given.
    """

    def decorate(command: Callable[..., None]) -> Callable[..., None]:
        chosen = {name: _parameter(name, optional, needs_input) for name in names or FIELDS}
        signature = inspect.signature(command)
        parameters: list[inspect.Parameter] = []
        for one in signature.parameters.values():
            own = one.replace(kind=inspect.Parameter.KEYWORD_ONLY)
            parameters += chosen.values() if one.name == "selection" else [own]

        @wraps(command)
        def with_options(**values: Any) -> None:
            selection = as_fields({name: values.pop(name) for name in chosen})
            if optional:
                selection = {name: value for name, value in selection.items() if value}
            command(**values, selection=selection)

        with_options.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
        with_options.__annotations__ = {one.name: one.annotation for one in parameters}
        return with_options

    return decorate


def as_fields(values: Mapping[str, Any]) -> dict[str, Any]:
    """Values as the command line has them, as `Selection` takes them: tuples for lists and joined words."""
    found = {}
    for name, value in values.items():
        if FIELDS[name].metadata.get("repeated"):
            value = tuple(value or ())
        elif FIELDS[name].metadata.get("joined"):
            value = tuple(part for part in value.split(",") if part)
            if name == "range":
                value = _numbers(value)
        found[name] = value
    if "input" in found and len(found["input"]) < 2:
        found["input"] = next(iter(found["input"]), None)
    return found


def _numbers(words: tuple[str, ...]) -> tuple[float, ...]:
    try:
        numbers = tuple(map(float, words))
    except ValueError:
        numbers = ()
    if words and len(numbers) != 2:
        raise typer.BadParameter("--range is LOW,HIGH: two numbers, such as 2,20")
    return numbers


def values_of(value: str | tuple[str, ...] | None) -> tuple[str, ...]:
    """No, one or several inputs, as a tuple."""
    return value if isinstance(value, tuple) else () if value is None else (value,)


def _parameter(name: str, optional: bool, needs_input: bool) -> inspect.Parameter:
    """One option for typer."""
    field = FIELDS[name]
    said = field.metadata
    if said.get("repeated"):
        kind, default = list[str] | None, None
        if name == "input" and needs_input:
            kind, default = list[str], MISSING
    elif said.get("joined"):
        kind, default = str, ""
    elif optional and field.type is not bool:
        kind, default = field.type | None, None  # type: ignore[operator]
    else:
        kind, default = field.type, field.default
    flag = f"--{name.replace('_', '-')}"
    choices = said.get("choices", ())
    option = typer.Option(
        flag,
        help=said["help"],
        metavar=said.get("metavar", "|".join(choices) or None),
        min=said.get("least"),
        callback=one_of(*choices) if choices else None,
    )
    return inspect.Parameter(
        name,
        inspect.Parameter.KEYWORD_ONLY,
        default=inspect.Parameter.empty if default is MISSING else default,
        annotation=Annotated[kind, option],
    )
