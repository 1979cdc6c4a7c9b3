"""Options as fields of dataclasses: the command line, configuration files and the page read them there.

No import of this module loads JAX: `hysid --help` reads the fields.
"""

from collections.abc import Iterable, Mapping
from dataclasses import MISSING, Field, field
from pathlib import Path
from typing import Any


def option(help: str, default: Any = MISSING, **said: Any) -> Any:
    """A field with its help text.

    **Arguments:**

    - `metavar`: what help shows for the value. `choices`: the words that it may be. `least`, `most`: the
      range of a number. `flag`: the words of the command line, where they are not the field's name.
    - `repeated`: the command line repeats the option. `joined`: the command line and a configuration file
      put commas between its words. `argument`: it has no name there.
    """
    return field(default=default, metadata={"help": help} | said)


def option_words(known: Iterable[Field[Any]], values: Mapping[str, Any]) -> list[str]:
    """Arguments, and options that differ from their defaults, as words of a command line.

    {"input": "force (N)", "nan": "omit"}  ->  --input "force (N)" --nan omit
    """
    words: list[str] = []
    for one in known:
        value, said = values.get(one.name), one.metadata
        if not is_given(one, value):
            continue
        named = said.get("flag", f"--{one.name.replace('_', '-')}").split("/")
        flag = [] if said.get("argument") else named[:1]
        listed = [*map(_word, value if isinstance(value, (tuple, list)) else [value])]
        if isinstance(value, bool):
            words += named[:1] if value else named[1:]
        elif said.get("repeated"):
            words += [word for each in listed for word in (*flag, each)]
        else:
            words += [*flag, *([",".join(listed)] if said.get("joined") else listed)]
    return words


def is_given(one: Field[Any], value: Any) -> bool:
    """Whether an option has a value that is not its default."""
    return value not in (None, (), []) and value != one.default


def _word(value: Any) -> str:
    """A value; no option parser takes the name of a file for an option."""
    word = str(value)
    return f"./{word}" if isinstance(value, Path) and word.startswith("-") else word
