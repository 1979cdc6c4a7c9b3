"""Text of others, written for machines: one function for each language it is written into.

Names and units come from files of strangers. Whatever they hold, the text that these functions return stays
what it is meant to be: a comment, a string, a word.
"""

import html
import re
import shlex

_SURROGATE = re.compile("[\ud800-\udfff]")


def visible(text: str, keep: str = "") -> str:
    """Text in which a control character, a mark of direction or half a character is written as <U+202E>.

    A terminal, an editor or a browser would act on them: text could then look other than it is.

    - `keep`: characters among them that stay, such as line ends.
    """
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() or c in keep else f"<U+{ord(c):04X}>" for c in text)


def c_comment(text: str) -> str:
    """Text for the inside of a C or C++ comment, on one line.

    Nothing in it ends a comment, begins another, continues a line or is a trigraph.
    """
    text = visible(text).replace("\\", "<U+005C>")
    return re.sub(r"(?<=[*/])(?=[*/])|(?<=\?)(?=\?)", " ", text)


def c_string(text: str) -> str:
    r"""A C or C++ string literal, quotes included: UTF-8, all but printable ASCII as \303."""
    raw = text.encode("utf-8", "backslashreplace")
    plain = (chr(b) if 32 <= b < 127 and chr(b) not in '"\\?' else f"\\{b:03o}" for b in raw)
    return f'"{"".join(plain)}"'


def markup(text: str) -> str:
    """Text for HTML, SVG and XML, between tags or within quotes."""
    return html.escape(visible(text, keep="\n\t"))


def toml_string(text: str) -> str:
    """A TOML string, quotes included.

    Half a character, which TOML cannot hold, becomes the mark for what cannot be read.
    """
    short = {'"': '\\"', "\\": "\\\\", "\n": "\\n", "\t": "\\t", "\r": "\\r"}
    found = []
    for c in _SURROGATE.sub("\ufffd", text):
        found.append(short.get(c) or (c if c.isprintable() else f"\\U{ord(c):08x}"))
    return f'"{"".join(found)}"'


def toml_comment(text: str) -> str:
    """Text for a TOML comment, on one line."""
    return visible(text)


def json_text(text: str) -> str:
    r"""A JSON document that UTF-8 can hold: half a character is written as \udc80, and read as that."""
    return _SURROGATE.sub(lambda found: f"\\u{ord(found[0]):04x}", text)


def shell_word(text: str) -> str:
    """A word of a command to copy into a POSIX shell; with $'...' where a character cannot be seen.

    sh, bash and zsh then run exactly this word, and nothing in it.
    """
    if text.isprintable():
        return shlex.quote(text)
    raw = text.encode("utf-8", "surrogateescape")
    plain = (chr(b) if 32 <= b < 127 and chr(b) not in "'\\" else f"\\{b:03o}" for b in raw)
    return f"$'{''.join(plain)}'"
