"""Remedies of errors: the options that they name are those of the command that says them."""

import re
from collections.abc import Sequence
from typing import Any

from ..intake._selection_options import ASIDE

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
    from hysteresis import InputError  # late: a foreign package is told before

    assert isinstance(error, InputError)
    return InputError(error.code, error.problem, place=error.place, cause=error.cause, fix=fix)


def options_of_command(command: Any) -> set[str]:
    """The long options of a command."""
    names = (name for one in command.params for name in (*one.opts, *one.secondary_opts))
    return {name for name in names if name.startswith("--")}
