"""What every command does with the terminal: results on stdout; progress, log and errors on stderr."""

import contextlib
import json
import os
import sys
import tempfile
import time
import traceback
from collections.abc import Iterable
from typing import Any, NamedTuple, NoReturn

from .._compile_cache import keep_compiled

PURPOSES = {
    "predict": "to predict", "compensate": "to compensate", "constants": "for its constants",
}  # fmt: skip
"""What a verdict is for, in words."""

BUG, USER, INTERRUPTED, CLOSED = 1, 2, 130, 141
"""Exit status: a fault of hysid, of the user's data or settings, an interruption, a reader that is gone."""

SOON = 2.0
"""Seconds of a command before which it says nothing of what is left."""


class Done(NamedTuple):
    """What a command has found: the object of --json, lines for a reader, and its exit status."""

    document: dict[str, Any]
    lines: Iterable[str]
    status: int = 0


def example(command: str) -> str:
    """The end of a command's help: one line that can be copied."""
    return f"Example:\n\n\b\n  {command}"  # \b: a line that is not wrapped


def start_jax(double: bool = True) -> None:
    """Load JAX in double precision, with one thread for small matrices, and keep compiled programs."""
    for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(variable, "1")
    if refused := keep_compiled():
        log(f"Note: {refused}")
    import jax  # late: it takes a second, and --help needs none of it

    jax.config.update("jax_enable_x64", double)
    LEFT.begin = time.monotonic()


def print_result(document: dict[str, Any], as_json: bool, lines: Iterable[str]) -> None:
    """The one JSON object, or lines for a reader, on stdout."""
    if as_json:
        from hysteresis._format import plain  # late: it loads NumPy

        text = _json(plain(document), sys.stdout.encoding)
    else:
        text = "\n".join(_shown(line) for one in lines for line in one.split("\n"))
    try:
        print(text, flush=True)
    except BrokenPipeError:  # its reader is gone, as in `hysid ... | head`: end as others do
        # What Python still wants to write at its end has nowhere to go either.
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        raise SystemExit(CLOSED) from None


class Left:
    """What is left of a run whose parts to come take as long as those done; it begins when it is made, and
    anew behind the line after which the parts are counted anew, as for each value of a column."""

    def __init__(self) -> None:
        self.begin = self._last = time.monotonic()
        self._done = 0

    def __call__(self, done: int, total: int) -> str:
        """As words behind a line; "" in the first `SOON` seconds, and at the end."""
        now = time.monotonic()
        if total:
            self.begin = self._last if done < self._done else self.begin
            self._done, self._last = done, now
        spent = now - self.begin
        if spent < SOON or not 0 < done < total:
            return ""
        seconds = spent * (total - done) / done
        unit, name = next(
            one for one in ((3600.0, "h"), (60.0, "min"), (0.0, "s")) if seconds >= 2 * one[0]
        )
        return f"; about {seconds / (unit or 1.0):.0f} {name} left"


LEFT = Left()
"""Of the command that runs."""

PROGRESS = "progress"
"""Code of the lines of `Progress`, which say themselves what is left."""


def logs_json() -> bool:
    """Whether another program reads what is logged."""
    return os.environ.get("HYSID_LOG") == "json"


def log(line: str) -> None:
    """A line on stderr; with HYSID_LOG=json one JSON object, which has a note's fields too."""
    if logs_json():
        fields = {
            name: getattr(line, name) for name in ("code", "done", "total") if hasattr(line, name)
        }
        print(json.dumps({"said": str(line), **fields}), file=sys.stderr, flush=True)
        return
    done, total = (int(getattr(line, name, 0)) for name in ("done", "total"))
    left = "" if getattr(line, "code", "") == PROGRESS else LEFT(done, total)
    print(_shown(line + left), file=sys.stderr, flush=True)


def _shown(text: str) -> str:
    """A line that a terminal only shows; the streams write "\\u2212" for characters that they lack."""
    if not text.isprintable():
        with contextlib.suppress(ImportError):
            from hysteresis._escape import visible  # late: that package may be a foreign one

            text = visible(text)
    return text


def _json(document: Any, encoding: str | None) -> str:
    """One JSON object, in ASCII where the stream has no other or the terminal would act on others."""
    unicode = (encoding or "utf-8").lower().replace("-", "") == "utf8"
    text = json.dumps(document, ensure_ascii=not unicode)
    return text if text.isprintable() else json.dumps(document)


def verdict_lines(document: dict[str, Any]) -> list[str]:
    """The level, the model, and the reasons."""
    purpose = PURPOSES[document["purpose"]]
    lines = [f"{document['verdict']['level']}: {document['model']} ({purpose})"]
    return lines + [f"  {reason['text']}" for reason in document["verdict"]["reasons"]]


def candidate_lines(document: dict[str, Any]) -> list[str]:
    """Models and baselines with their errors: on held-out parts of the training rows, on the test rows."""
    from hysteresis._show import aligned  # late: it loads JAX, which runs by now

    unit = document["data"]["output"]["unit"]
    named = [(c["model"], c) for c in document["candidates"]]
    named += [(f"({b['name']})", b) for b in document["baselines"]]
    rows = [["  model, or (baseline)", "folds, %", "held out, %", f"rms{_in(unit)}"]]
    for name, one in named:
        test = one["metrics"]["test"] or {}
        cells = one["score_percent"], test.get("nrmse_percent"), test.get("rmse")
        rows.append([f"  {name}", *("-" if x is None else f"{x:.3g}" for x in cells)])
    return aligned(rows, range(1, 4))


def compensator_lines(document: dict[str, Any]) -> list[str]:
    """The error of the compensator, beside those of simple inverses; nothing where there is none."""
    found = document.get("compensator")
    if not found or found["refused"]:
        return []
    unit = _in(document["data"]["input"]["unit"]).removeprefix(",")
    beside = [f"{one['name']} {one['rmse']:.3g}{unit}" for one in found["baselines"]]
    lines = [f"  Backwards: compensator {found['rmse']:.3g}{unit} rms; {', '.join(beside)}"]
    if better := " and ".join(found["better"]):
        verb = "are" if found["better"][1:] else "is"
        lines.append(f"  Warning: backwards, {better} {verb} better than the model.")
    return lines


def _in(unit: str) -> str:
    return "" if unit == "1" else f", {unit}"


def warnings(sentences: Iterable[str], word: str = "Warning") -> list[str]:
    """Each on a line of its own, with the word before it that says what it is."""
    return [f"{word}: {sentence}" for sentence in sentences]


class Progress:
    """How far a long run is, on stderr: a bar on a terminal, a line for every tenth elsewhere.

    `later`: it is shown where the run takes more than `SOON` seconds only.
    """

    def __init__(self, what: str, later: bool = False):
        self._what, self._later = what, later
        self._left = Left()
        self._bar: Any = None
        self._task: Any = None
        self._part = -1

    def __enter__(self) -> "Progress":
        return self

    def __call__(self, done: int, total: int, text: str) -> None:
        if self._later:
            if time.monotonic() < self._left.begin + SOON:
                return
            text += self._left(done, total)
        if sys.stderr.isatty():
            if self._bar is None:
                # late: most commands show no bar
                from rich.console import Console
                from rich.progress import Progress as Bar

                self._bar = Bar(console=Console(stderr=True))
                self._bar.start()
                self._task = self._bar.add_task(self._what, total=total)
            self._bar.update(self._task, completed=done, total=total, description=text)
        elif (part := (100 if logs_json() else 10) * done // total) != self._part:
            self._part = part
            from hysteresis._verdict import ProgressNote  # late: as `visible`

            said = f"{self._what}: {100 * done // total} %, {text}"
            log(ProgressNote(PROGRESS, said, done, total))

    def __exit__(self, *_: object) -> None:
        if self._bar is not None:
            self._bar.stop()


def fault(code: str, message: str, where: str = "", fix: str = "") -> dict[str, str]:
    """Why a command ended: what `InputError.document` has, "" where there is nothing to say."""
    return {"code": code, "message": message, "where": where, "cause": "", "fix": fix}


def stop(document: dict[str, str], text: str, status: int, as_json: bool) -> NoReturn:
    """End with one line on stderr: a sentence, or one JSON object."""
    if as_json:
        print(_json({"error": document}, sys.stderr.encoding), file=sys.stderr, flush=True)
    else:
        log(f"hysid: {text}")
    raise SystemExit(status)


def explain(error: Exception) -> tuple[dict[str, str], str, int]:
    """What an exception means to the user: the fault, the same as text, and the exit status."""
    # Known by its method: newer typers bring their own click, older ones need the package.
    if (usage := getattr(error, "format_message", None)) is not None:
        message = f"{usage().rstrip('.')}."
        if (context := getattr(error, "ctx", None)) is None:
            return fault("usage", message), message, USER
        hint = f"See: {context.command_path} --help"
        return fault("usage", message, context.command_path, fix=hint), f"{message} {hint}", USER
    # Not imported here: what failed may be that very import.
    known = getattr(sys.modules.get("hysteresis"), "InputError", None)
    if known is not None and isinstance(error, known):
        return error.document, str(error), USER  # type: ignore[attr-defined]
    if isinstance(error, OSError):
        place, why = str(error.filename or "the disk"), f"{error.strerror or error}."
        if isinstance(error, FileExistsError | NotADirectoryError):
            why = "a file is where a folder is needed."
        return fault("os-error", why, place), f"{place}: {why}", USER
    said = ": ".join([type(error).__name__, *str(error).splitlines()[:1]])
    if isinstance(error, ImportError):
        message = f"The installation is not complete ({said})."
        fix = "Install hysid again, in an environment of its own."
        return fault("broken-install", message, fix=fix), f"{message} Fix: {fix}", USER
    message = f"This is a bug in hysid, not your doing ({said})."
    details = _details(error)
    document = fault("bug", message, details, "Report the bug with this file.")
    return document, f"{message} Details: {details}", BUG


def _details(error: Exception) -> str:
    """Where the traceback was written; without a folder to write to, the line that raised."""
    try:
        with tempfile.NamedTemporaryFile(
            "w", suffix=".txt", prefix="hysid-", delete=False, encoding="utf-8",
            errors="backslashreplace",
        ) as details:  # fmt: skip
            traceback.print_exception(error, file=details)
    except OSError:
        last = traceback.extract_tb(error.__traceback__)[-1:]
        return ", ".join(f"{frame.filename}, line {frame.lineno}" for frame in last)
    return details.name
