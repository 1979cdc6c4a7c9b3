"""A selection as words of a command line."""

from collections.abc import Mapping
from typing import Any

from hysteresis._escape import shell_word

from ._selection_options import FIELDS


def as_words(options: Mapping[str, Any]) -> str:
    """The selecting options that differ from their defaults, quoted for a shell.

    {"input": "force (N)", "nan": "omit"}  ->  --input 'force (N)' --nan omit
    """
    words: list[str] = []
    for name, field in FIELDS.items():
        value = options.get(name)
        if value in (None, False, (), []) or value == field.default:
            continue
        flag = f"--{name.replace('_', '-')}"
        listed = list(value) if isinstance(value, (tuple, list)) else [value]
        if value is True:
            words.append(flag)
        elif field.metadata.get("joined"):
            words += [flag, shell_word(",".join(map(str, listed)))]
        else:
            words += [word for one in listed for word in (flag, shell_word(str(one)))]
    return " ".join(words)
