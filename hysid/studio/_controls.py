"""Controls of the page: what it calls the options of the commands, and texts that name them.

A message of a command names options (`--step VALUE`), which a page does not have. `on_page` says the
control in place of each, so that every message can be followed where it is read.
"""

import re
from typing import Any

from ..intake._fit_options import FIT_FIELDS
from ..intake._selection_options import ASIDE, FIELDS

ROLES = {
    "input": "input", "output": "output", "time": "time", "input_time": "time of the input",
    "group": "separates sequences", "each": "one fit for each value", "condition": "condition",
    "sigma": "standard deviation",
}  # fmt: skip
"""Options that name columns: a role in the table of columns."""

_ELSEWHERE = {
    "input_unit": "Unit", "output_unit": "Unit", "test_cycles": "Held out for testing",
    "test_tail": "Held out for testing", "test_lines": "Hold out", "exclude_lines": "Exclude",
    "model": "Model", "purpose": "The model is meant",
}  # fmt: skip
"""Options with a control of their own elsewhere on the page."""

_SELECTION = {
    "dt": "Time between samples", "step": "Constant input", "hold": "Creep or relaxation",
    "turn": "Turned signs", "where": "Only these rows", "branch": "Branch",
    "range": "Range of the input", "test_where": "Held out by values", "nan": "Missing values",
    "segments": "New sequences", "decimal": "Decimal sign", "units_row": "Line of the units",
    "na_values": "Words for missing values", "table": "Table of the file",
}  # fmt: skip

_FIT = {
    "initial": "Memory at the start", "conditioning": "First cycle", "clocks": "Lag", "drift": "Drift",
    "noise": "Noise", "starts": "Random starts", "period": "Period", "oversampling": "Oversampling",
}  # fmt: skip
"""Further settings of a fit."""

_LABELS = ROLES | _ELSEWHERE | _SELECTION | _FIT
_BUTTONS = {
    "init": "Guess again", "fit": "Fit", "sample": "Sample the posterior", "check": "Measurement",
    "qualify": "Try the compensator", "predict": "Try the compensator", "report": "Write the report",
    "export": "Export the compensator",
}  # fmt: skip

_PROSE = frozenset({
    "message", "cause", "fix", "why", "text", "said", "notes", "reasons", "reason", "no_roles",
    "skipped", "help", "basis",
})  # fmt: skip
"""Keys whose texts people read; all others hold names, which stay as they are."""

_PLACE = r"(?:[ =]\"?[A-Z](?:[A-Z,=\[\]-]*[A-Z\]])?(?:\.[a-z]+)?\"?(?![a-z]))?"
"""A word that stands for a value in a message, such as COL or "COL" or FIRST-LAST."""
_OPTION = re.compile(rf"(?<![\w-])--([a-z][a-z0-9-]+){_PLACE}")
_WITH_OPTIONS = re.compile(rf"\bhysid [a-z]+(?: [a-z]+)?{_PLACE}{_PLACE} (?=--[a-z])")
_COMMAND = re.compile(rf"\bhysid ({'|'.join(_BUTTONS)})\b{_PLACE}{_PLACE}")


def settings() -> list[dict[str, Any]]:
    """The settings that the page offers besides roles, units and held-out rows: one for each option."""
    return [
        {
            "of": table, "name": name, "label": label, "help": said.metadata["help"],
            "choices": said.metadata.get("choices", ()), "default": said.default,
            "kind": _kind(said.type, said.metadata),
        }
        for table, labels, known in (("selection", _SELECTION, FIELDS), ("fit", _FIT, FIT_FIELDS))
        for name, label in labels.items()
        for said in (known[name],)
    ]  # fmt: skip


def on_page(text: str) -> str:
    """A text of a command that names the page's controls in place of options and commands.

    What names an option that the page lacks is left out, as long as something is left.

        >>> on_page("Give the constant input (--step VALUE), or use --overwrite.")
        'Give the constant input (“Constant input”).'
    """
    text = _WITH_OPTIONS.sub("", text)
    text = ASIDE.sub(lambda found: "" if _lacks(found[0]) else found[0], text)
    if _lacks(text):
        kept = [_without_lacking(sentence) for sentence in re.split(r"(?<=[.!?;]) ", text)]
        text = " ".join(filter(None, kept)) or text
    text = _OPTION.sub(lambda found: f"“{_label(found[1])}”", text)
    text = _COMMAND.sub(lambda found: f"“{_BUTTONS[found[1]]}”", text)
    return text.replace("” “", "” and “")


def worded(document: Any, prose: bool = False) -> Any:
    """Plain data whose texts for people are as `on_page`."""
    if isinstance(document, dict):
        return {key: worded(value, prose or key in _PROSE) for key, value in document.items()}
    if isinstance(document, list | tuple):
        plain = not document or isinstance(document[0], int | float)
        return document if plain else [worded(one, prose) for one in document]
    return on_page(document) if prose and isinstance(document, str) else document


def _lacks(text: str) -> bool:
    return any(name.replace("-", "_") not in _LABELS for name in _OPTION.findall(text))


def _without_lacking(sentence: str) -> str:
    kept = [one for one in re.split(r",? or (?=[a-z]+ )", sentence) if not _lacks(one)]
    said = ", or ".join(kept)
    return said if not said or said[-1] in ".!?;" else f"{said}."


def _label(option: str) -> str:
    return _LABELS.get(option.replace("-", "_"), option.replace("-", " "))


def _kind(hint: Any, said: Any) -> str:
    if hint is bool:
        return "check"
    if said.get("repeated") or said.get("joined"):
        return "list"
    return "number" if hint in (float | None, int | None, int) else "text"
