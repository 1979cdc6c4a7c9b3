"""The options of a fit: each field is a command-line option, a key of a configuration file, and a keyword.

No import of this module loads JAX: `hysid --help` reads the fields.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import MISSING, Field, dataclass, field, fields
from functools import partial
from pathlib import Path
from typing import Any


def option(help: str, default: Any = MISSING, **said: Any) -> Any:
    """A field with its help text.

    **Arguments:**

    - `metavar`: what help shows for the value. `choices`: the words that it may be. `least`, `most`: the
      range of a number. `flag`: the words of the command line, where they are not the field's name.
    - `repeated`: the command line repeats the option. `joined`: the command line and a configuration file
      put commas between its words. `argument`: it has no name there.
    - `of`: what of the command has to be there for the option to have an effect: attribute, and words.
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


def has_shape(one: Field[Any], words: Sequence[str]) -> bool:
    """Whether words are numbers, as many as the option's metavar has; with brackets in it as many as there
    are."""
    shape = one.metadata["metavar"]
    try:
        count = len([*map(float, words)])
    except ValueError:
        return False
    return not words or "[" in shape or count == len(shape.split(","))


def _word(value: Any) -> str:
    """A value; no option parser takes the name of a file for an option."""
    word = str(value)
    return f"./{word}" if isinstance(value, Path) and word.startswith("-") else word


MODELS = (
    "LinearSponge", "Burgers", "Preisach", "EverettSurface", "Composition", "Butterfly", "FoamCurve",
    "BoucWen", "PrandtlIshlinskii", "DegradingBoucWen", "StandardLinearSolid", "GeneralizedKelvinVoigt",
    "GeneralizedMaxwell", "DuhemOperator", "GaussianPreisach", "TwoGaussianPreisach",
    "LorentzianPreisach", "Oscillator",
)  # fmt: skip
"""Our own names of `--model`, written here because `--help` does not wait for JAX; a test compares them."""


_auto_or_keep = partial(option, default="auto", choices=("auto", "keep"))


@dataclass(frozen=True, kw_only=True)
class FitOptions:
    """How a model is fitted. `of_step`: creep and relaxation have it too; `of_shared`: specimens
    that share parameters do; `of_motion`: oscillators do."""

    model: str = option(
        f"auto, or NAME[,NAME], in any case: {', '.join(MODELS)}, or a model of an installed"
        " distribution (entry-point group hysid.models).",
        "auto",
        of_shared=True,
        of_motion=True,
    )
    initial: str = option(
        "Memory before the first sample: auto, negative, positive, demagnetised, or fit.",
        "auto",
        choices=("auto", "negative", "positive", "demagnetised", "fit"),
    )
    conditioning: str = _auto_or_keep(
        "auto: exclude the first cycle where that predicts better; keep: never exclude it."
    )
    clocks: str = _auto_or_keep(
        "auto: correct a lag between input and output and smooth a staircase; keep: change nothing."
    )
    drift: str = _auto_or_keep(
        "auto: a drift explains the training rows and is not in the model; keep: it is in the model, and"
        " stops at its last value."
    )
    score: str = option(
        "What is to be least: rms, the error of all rows; sre, that of each sequence in parts of the rms of"
        " its output, so that small loops count.",
        "rms",
        choices=("rms", "sre"),
    )
    noise: str = option(
        "Noise model: auto, or gaussian, student-t, ar1, arma11, growing, input, misfit, joined with +.",
        "auto",
    )
    parameter: tuple[str, ...] = option(
        'What is known of a parameter; repeatable: "E1 start=2 bounds=1,4", "b fixed=0",'
        ' "K prior=normal(1, 0.1)", "E2 tied=2 * E1". Of a spectrum: "E_inf fixed=0",'
        ' "tau bounds=0.1,100".',
        (),
        repeated=True,
        of_step=True,
    )
    terms: int | None = option(
        "Creep, relaxation, moduli: a series of this many time constants (default: as many as the rows call"
        " for, or a dense spectrum).",
        None,
        least=0,
        of_step=True,
        of_motion=True,
    )
    tau: tuple[float, ...] = option(
        "Creep, relaxation, moduli: a series of these time constants.",
        (),
        joined=True,
        metavar="TAU[,TAU]",
        of_step=True,
        of_motion=True,
    )
    like: tuple[str, ...] = option(
        "Fits of earlier specimens of the same kind: few cycles tell the rest.",
        (),
        joined=True,
        metavar="FOLDER[,FOLDER]",
    )
    share: tuple[str, ...] = option(
        "Parameters that are the same in all specimens: those of several FILEs, or of --each.",
        (),
        joined=True,
        metavar="NAME[,NAME]",
        of_shared=True,
    )
    starts: int = option(
        "Random starts for non-linear parameters.", 32, least=1, of_shared=True, of_motion=True
    )
    seed: int = option(
        "Seed of every random number.", 0, least=0, of_step=True, of_shared=True, of_motion=True
    )
    purpose: str = option(
        "What the verdict is for: predict; compensate, which tries the compensator too; or constants, which"
        " needs a standard error for every parameter.",
        "predict",
        choices=("predict", "compensate", "constants"),
        of_step=True,
        of_shared=True,
        of_motion=True,
    )
    period: int | None = option(
        "Oscillator: rows in a period of the force, in steady state; 0: it does not repeat (default: looked"
        " for).",
        None,
        least=0,
        of_motion=True,
    )
    oversampling: int = option(
        "Oscillator: steps of integration to a sample.", 20, least=1, of_motion=True
    )
    budget: float | None = option(
        "Seconds after which no further model or start is begun: the best so far is the result.",
        None,
    )
    allow_float32: bool = option(
        "Fit in single precision; standard errors are rough.", False, of_step=True
    )


FIT_FIELDS = {one.name: one for one in fields(FitOptions)}
"""By name, in the order in which help lists them."""

OF_SPECTRA = ("terms", "tau")
"""Those of creep, relaxation and moduli alone."""


# The selecting options: each field is a command-line option, a key of a configuration file, and a keyword.
#
# A new option is one field here. No import of this module loads JAX: `hysid --help` reads the fields.

ASIDE = re.compile(r"\s*\((?=[^()]*--[a-z])[^()]*\)")
"""Brackets of a message that name options, with the blanks before them."""


_words = partial(option, default=(), joined=True)
_column = partial(option, default=None, metavar="COL")
_unit = partial(option, default=None, metavar="UNIT")


@dataclass(frozen=True)
class SelectionOptions:
    """Which rows and columns of a file are used, and which rows are held out for testing."""

    input: str | tuple[str, ...] | None = option(
        "Input column: its exact header. Repeat it for a sensor with several channels.",
        repeated=True,
        metavar="COL",
    )
    output: str = option("Output column: its exact header.", metavar="COL")
    time: str | None = _column("Time column.")
    dt: float | None = option(
        "Time between samples in seconds, where there is no time column.", None, metavar="SECONDS"
    )
    input_time: str | None = _column(
        "Time column of the input, where it has a clock of its own; --time is the output's."
    )
    step: float | None = option(
        "Fit creep or relaxation under this constant input, instead of --input.",
        None,
        metavar="VALUE",
    )
    frequency: str | None = _column(
        "Frequency column: fit a spectrum to moduli over frequency, --output being the storage modulus,"
        " instead of --input."
    )
    loss: str | None = _column("Column of the loss modulus, or of tan delta, beside --frequency.")
    hold: bool = option(
        "Fit creep or relaxation over the longest stretch in which --input is constant.", False
    )
    group: tuple[str, ...] = _words(
        "Rows with different values are independent sequences of one model.", metavar="COL[,COL]"
    )
    condition: tuple[str, ...] = _words(
        "The output depends on this column too: a temperature, a pressure, ...", metavar="COL[,COL]"
    )
    turn: tuple[str, ...] = _words(
        "Turn the sign of these columns: a push that the rig counts as a pull.", metavar="COL[,COL]"
    )
    rezero: tuple[str, ...] = _words(
        "Take jumps of the output's zero out: subtract SIZE from the output, from this line of the file to"
        " the end of its sequence. check finds line and size.",
        metavar="LINE:SIZE[,LINE:SIZE]",
    )
    known: str | None = option(
        "The output of the first N rows of every sequence, or of as many as this column says, is known"
        " beforehand: they tell the state in which the rest begins, and do not count.",
        None,
        metavar="N|COL",
    )
    sigma: str | None = _column(
        "Column of the output's standard deviation: fit, noise, errors and verdict weigh each row by its"
        " inverse square. Only ratios from row to row count."
    )
    each: str | None = _column("Fit one model for each value of this column.")
    where: tuple[str, ...] = option(
        "Use only these rows; repeatable.", (), repeated=True, metavar="COL=VALUE[,VALUE]"
    )
    branch: str | None = option(
        "Count only rows in which the input rises (loading) or falls (unloading), or each branch for itself"
        " (both). A sample where it turns belongs to both. All other rows are history.",
        None,
        choices=("loading", "unloading", "both"),
    )
    range: tuple[float, ...] = _words(
        "Count only rows with the input in this range; the others are history.", metavar="LOW,HIGH"
    )
    test_where: tuple[str, ...] = option(
        "Hold out these rows for testing; COL%2=0 holds out even values; repeatable.",
        (),
        repeated=True,
        metavar="COL=VALUE[,VALUE]",
    )
    test_cycles: int | None = option(
        "Hold out the last N cycles of each sequence for testing.", None, least=1, metavar="N"
    )
    test_tail: float | None = option(
        "Hold out this last fraction of each sequence for testing.", None, metavar="FRACTION"
    )
    test_lines: tuple[str, ...] = _words(
        "Hold out the rows on these lines of the file for testing.",
        metavar="FIRST-LAST[,FIRST-LAST]",
    )
    exclude_lines: tuple[str, ...] = _words(
        "Leave the rows on these lines of the file out of the fit; they still drive the model.",
        metavar="FIRST-LAST[,FIRST-LAST]",
    )
    nan: str = option(
        "Missing values: raise an error, omit (rows without output do not count, rows without both are left"
        " out), or interpolate.",
        "raise",
        choices=("raise", "omit", "interpolate"),
    )
    segments: str | None = option(
        "auto: a new sequence begins where the time goes back.", None, choices=("auto",)
    )
    decimal: str = option("Decimal sign of the file: . or ,", ".", choices=(".", ","))
    units_row: int | None = option(
        "Number of the line that holds the units; 0 for none.", None, least=0, metavar="N"
    )
    na_values: tuple[str, ...] = _words("Words that mean a missing value.", metavar="WORD[,WORD]")
    table: int | None = option(
        "Which of the file's tables with different headers; the longest if not given.",
        None,
        least=1,
        metavar="N",
    )
    dialects: str | None = option(
        "TOML file of further layouts of rig files.", None, metavar="FILE"
    )
    input_unit: str | None = _unit(
        "Unit of the input or of --step, where the header does not give it."
    )
    output_unit: str | None = _unit("Unit of the output, where the header does not give it.")


FIELDS: dict[str, Field[Any]] = {one.name: one for one in fields(SelectionOptions)}
"""By name, in the order in which help and configuration files list them."""

OF_READING = ("decimal", "units_row", "na_values", "table", "dialects")
"""The options that say how a file is read, before any column is chosen."""

HELD_OUT = tuple(name for name in FIELDS if name.startswith("test_"))
"""The options that hold out rows: a command that only looks at a file has none of them."""
