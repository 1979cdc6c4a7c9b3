"""Docstrings, written in Markdown, as the reStructuredText that autodoc reads.

Equations are typeset: an indented block in plain text if `equations` can read it, a `math` fence as TeX.
Other indented blocks are programs and examples, and stay as they are.
"""

import re
from collections.abc import Mapping, Sequence
from typing import Any

import equations
from markdown_it import MarkdownIt

_PARSER = MarkdownIt("commonmark")
_SPECIAL = re.compile(r"([\\*`|_<>\[\]:])")


def restructured(text: str, names: Mapping[str, str]) -> str:
    """The docstring with its paragraphs, lists and equations; `names` maps what is a link to its target."""
    return "\n".join(_blocks(_PARSER.parse(text), names))


def _blocks(tokens: Sequence[Any], names: Mapping[str, str]) -> list[str]:
    lines: list[str] = []
    indent, bullets = "", []
    for token in tokens:
        if token.type in ("bullet_list_open", "ordered_list_open"):
            bullets.append("- " if token.type.startswith("bullet") else "#. ")
        elif token.type in ("bullet_list_close", "ordered_list_close"):
            bullets.pop()
        elif token.type == "list_item_open":
            lines.append(indent + bullets[-1])
            indent += " " * len(bullets[-1])
        elif token.type == "list_item_close":
            indent = indent[: -len(bullets[-1])]
        elif token.type == "inline":
            shown = indent + _inline(token.children or (), names)
            begun = bool(lines) and bool(lines[-1].strip()) and lines[-1].endswith(("- ", "#. "))
            if begun:  # the first paragraph of a list item stands beside its bullet
                lines[-1] += shown[len(indent) :]
            else:
                lines.append(shown)
            lines.append("")
        elif (equation := _equation(token)) is not None:
            lines += [f"{indent}.. math::", ""]
            lines += [f"{indent}   {line}" for line in equation.split("\n")]
            lines.append("")
        elif token.type in ("code_block", "fence"):
            doctest = "pycon" if token.content.startswith(">>>") else "none"
            language = "python" if token.info == "python" else doctest
            lines += [f"{indent}.. code-block:: {language}", ""]
            lines += [f"{indent}   {line}" for line in token.content.rstrip("\n").split("\n")]
            lines.append("")
        elif token.type not in ("paragraph_open", "paragraph_close"):
            raise ValueError(f"docstrings hold no {token.type}")
    return lines


def _equation(token: Any) -> str | None:
    if token.type == "fence" and token.info == "math":
        return token.content.strip()
    return equations.tex(token.content.rstrip()) if token.type == "code_block" else None


def _inline(tokens: Sequence[Any], names: Mapping[str, str]) -> str:
    parts: list[str] = []
    mark = ""
    for token in tokens:
        if token.type in ("strong_open", "em_open"):
            mark = "**" if token.type == "strong_open" else "*"
            parts.append("\\ " + mark)
        elif token.type in ("strong_close", "em_close"):
            parts.append(mark + "\\ ")
        elif token.type == "code_inline":
            target = names.get(token.content.removesuffix("()"))
            shown = token.content
            if target is None:
                parts.append(f"\\ ``{shown}``\\ ")
            else:
                parts.append(f"\\ :py:obj:`{shown} <{target}>`\\ ")
        elif token.type in ("softbreak", "hardbreak"):
            parts.append(" ")
        elif token.type == "text":
            parts.append(_SPECIAL.sub(r"\\\1", token.content))
        else:
            raise ValueError(f"docstrings hold no {token.type}")
    return "".join(parts).strip().removeprefix("\\ ")
