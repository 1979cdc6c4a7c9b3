"""Equations in plain text, as docstrings write them for `help()`, as TeX for the reference.

It reads letters and the names of Greek ones, `x_k`, `x^2`, `E1`, products by a space, primes, words, and
two or more spaces between equations of one line. A block that may be anything else stays as it is.
"""

import re
from collections.abc import Sequence

GREEK = [
    *(
        "alpha",
        "beta",
        "gamma",
        "delta",
        "eps",
        "zeta",
        "eta",
        "theta",
        "kappa",
        "lambda",
        "mu",
        "nu",
    ),
    *("xi", "pi", "rho", "sigma", "tau", "phi", "chi", "psi", "omega"),
    *("Gamma", "Delta", "Sigma", "Phi", "Psi", "Omega"),
]
SIGNS = {
    "<-": r"\leftarrow ", "->": r"\rightarrow ", "<=": r"\leq ", ">=": r"\geq ", "...": r"\ldots ",
    "+-": r"\pm ", "~": r"\sim ", "{": r"\{", "}": r"\}", "%": r"\%", "inf": r"\infty ",
}  # fmt: skip
TOKEN = re.compile(
    r"\s+|[A-Za-z][A-Za-z0-9]*(?:_[A-Za-z0-9]+)*|\d+(?:\.\d+)?|<-|->|<=|>=|\+-(?=\d)|\.\.\.|."
)
CODE = re.compile(r">>>|==|\*|:\]|\"|`|#|\bimport\b|\w,[A-Z]\b|\$|\w\.\w{2,}\(")
"""A program, or a subscript that cannot be told from a list."""


RELATIONS = ("=", "~", "<", ">", "+", "-")


def tex(text: str) -> str | None:
    """The lines of a block as TeX; None where it is not certain to be an equation."""
    if CODE.search(text) or not re.search(r"[=~<^]", text):
        return None
    lines = []
    for line in text.rstrip().splitlines():
        made = r"\qquad " if line.startswith(" ") else ""
        before = ""
        for part in re.split(r"\s{2,}", line.strip()):
            goes_on = part.startswith(RELATIONS) or before.endswith(RELATIONS)
            made += ("" if goes_on or not before else r"\qquad ") + _line(part)
            before = part
        lines.append(made)
    return "\\\\\n".join(lines)


def _line(text: str, inside: bool = False) -> str:
    tokens = TOKEN.findall(text)
    made: list[str] = []
    k = 0
    while k < len(tokens):
        token = tokens[k]
        if token in "^_":
            group, k = _group(tokens, k + 1)
            made.append(f"{token}{{{_line(group, True)}}}")
        elif token == "sqrt" and tokens[k + 1 : k + 2] == ["("]:
            group, k = _group(tokens, k + 1)
            made.append(rf"\sqrt{{{_line(group)}}}")
        elif (token == "-" and _joins_words(tokens, k)) or (
            token == "'" and tokens[k + 1 : k + 2] == ["s"]
        ):
            made.append(rf"\text{{{token}}}")
            k += 1
        elif token == "in" and inside:
            made.append(r"\in ")
            k += 1
        elif token.isspace():
            made.append(_space(tokens, k))
            k += 1
        elif token == "x" and _crosses(tokens, k):
            made.append(r"\times ")
            k += 1
        elif (
            token == "."
            and 0 < k < len(tokens) - 1
            and tokens[k + 1][0].isalpha() | (tokens[k + 1] == "(")
        ):
            made.append(r"\cdot ")
            k += 1
        else:
            made.append(SIGNS.get(token) or (_name(token) if token[0].isalpha() else token))
            k += 1
    return "".join(made)


def _group(tokens: Sequence[str], k: int) -> tuple[str, int]:
    """What an exponent or a subscript holds, and the place after it."""
    if tokens[k] not in "({":
        end = k + 2 if tokens[k] == "-" else k + 1
        return "".join(tokens[k:end]), end
    depth, end = 1, k + 1
    while depth:
        depth += (tokens[end] in "({") - (tokens[end] in ")}")
        end += 1
    return "".join(tokens[k + 1 : end - 1]), end


def _crosses(tokens: Sequence[str], k: int) -> bool:
    """Whether a lone x stands between two vectors: `F x M`, but not `W x + b`."""
    before, after = tokens[k - 2 : k], tokens[k + 1 : k + 3]
    if len(before) < 2 or len(after) < 2 or not (before[1] == after[0] == " "):
        return False
    vector = before[0] == ")" or _is_symbol(before[0])
    return vector and _is_symbol(after[1]) and after[1] != "x"


def _space(tokens: Sequence[str], k: int) -> str:
    """A thin space between factors, a whole one beside words, none beside signs."""
    if k in (0, len(tokens) - 1):
        return ""
    sides = tokens[k - 1], tokens[k + 1]
    if not all(
        side[0].isalnum() or side in ("(", ")", "[", "]", "{", "}", "|", ",", ";", ":", "'")
        for side in sides
    ):
        return ""
    return r"\ " if any(side[0].isalpha() and not _is_symbol(side) for side in sides) else r"\,"


def _joins_words(tokens: Sequence[str], k: int) -> bool:
    sides = tokens[k - 1 : k] + tokens[k + 1 : k + 2]
    return len(sides) == 2 and all(side[0].isalpha() and not _is_symbol(side) for side in sides)


def _is_symbol(token: str) -> bool:
    """Whether a name is one letter or a sum, perhaps with a subscript or a d before it."""
    base = token.split("_")[0]
    return base == "sum" or bool(re.fullmatch(rf"d?(?:[A-Za-z]|{'|'.join(GREEK)})\d*", base))


def _name(token: str) -> str:
    base, *rest = token.split("_")
    if base == "sum":
        made = r"\sum"
    elif _is_symbol(token):
        found = re.fullmatch(rf"(d?)([A-Za-z]|{'|'.join(GREEK)})(\d*)", base)
        assert found is not None
        letter = (
            rf"\{'epsilon' if found[2] == 'eps' else found[2]}" if found[2] in GREEK else found[2]
        )
        made = (r"\mathrm{d}" if found[1] else "") + (letter + " " if len(letter) > 1 else letter)
        rest = [found[3], *rest] if found[3] else rest
    elif any(len(part) > 2 or part == "at" for part in rest):  # a parameter of the code
        return rf"\mathrm{{{token.replace('_', chr(92) + '_')}}}"
    else:
        made = rf"\mathrm{{{base}}}"
    if not rest:
        return made
    return made + f"_{{{','.join(_subscript(part) for part in rest)}}}"


def _subscript(part: str) -> str:
    if part in SIGNS or part in GREEK:
        return SIGNS.get(part) or rf"\{part}"
    return part if part.isdigit() or len(part) < 3 else rf"\mathrm{{{part}}}"
