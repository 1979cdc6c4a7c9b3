"""How programs of testing machines name their pieces of a text file."""

import re
from typing import NamedTuple


class Dialect(NamedTuple):
    """What a program writes.

    - `name`: of the program, for notes.
    - `signature`: what its files hold; `sure` where nothing else does.
    - `column`: what tells its tables apart; `label`: how a table's own name stands above it.
    - `decimal`: the decimal sign where the file says it, else "".
    """

    name: str
    signature: re.Pattern[str]
    column: str = "block"
    label: re.Pattern[str] | None = None
    sure: bool = True
    decimal: str = ""

    def label_of(self, above: list[list[str]]) -> str:
        """The name of a table from the rows of text above it, "" for none."""
        text = "\n".join("\t".join(cell for cell in row if cell) for row in above)
        if self.label is not None:
            found = self.label.search(text)
            return found["label"].strip() if found else ""
        return ""


_ANY = re.compile(r"(?s).*")
DIALECTS = (
    Dialect("an MTS file", re.compile(r"\AMTS793\|")),
    Dialect(
        "a TRIOS file", re.compile(r"(?im)^\[step\]\s*$"), "step",
        re.compile(r"(?im)^\[step\]\s*\n(?P<label>.+)$"),
    ),
    Dialect(
        "a Bluehill file", re.compile(r'(?im)^"?Results Table \d'), "specimen",
        re.compile(r'(?im)specimen[^\w\n]*(number|label|name|no\.?)?[^\w\n]*(?P<label>[\w .-]+)'),
    ),
    Dialect(
        "a testXpert file", re.compile(r"(?i)prüfzeit|standardkraft|standardweg|standard force"),
        "specimen", re.compile(r"(?im)^(specimen|probe)\W*(?P<label>[\w .-]+)"), False,
    ),
    Dialect(
        "a texture analyser's file",
        re.compile(r"(?im)force\W*\(?(g|N|kg)\)?[\t,;\"]+.*distance\W*\(?mm"), "curve",
        re.compile(r"(?P<label>\S.*)"), False,
    ),
)  # fmt: skip
OTHER = Dialect("a table with notes above it", _ANY, "block", re.compile(r"(?P<label>\S.*)"), False)


def dialect_of(text: str) -> Dialect:
    """The dialect of a file by its first lines."""
    found = next((d for d in DIALECTS if d.signature.search(text)), OTHER)
    if (
        found is DIALECTS[0]
    ):  # MTS793|MPT|ENU|1|2|.|/|:|1|0|0|A: the sixth field is the decimal sign
        field = text.split("\n", 1)[0].split("|")[5:6]
        return found._replace(decimal=field[0] if field and field[0] in (".", ",") else "")
    return found
