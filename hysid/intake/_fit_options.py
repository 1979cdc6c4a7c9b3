"""The options of a fit: each field is a command-line option, a key of a configuration file, and a keyword.

No import of this module loads JAX: `hysid --help` reads the fields.
"""

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
    that share parameters do."""

    model: str = option(
        f"auto, or NAME[,NAME], in any case: {', '.join(MODELS)}, or a model of an installed"
        " distribution (entry-point group hysid.models).",
        "auto",
        of_shared=True,
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
    )
    tau: tuple[float, ...] = option(
        "Creep, relaxation, moduli: a series of these time constants.",
        (),
        joined=True,
        metavar="TAU[,TAU]",
        of_step=True,
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
    starts: int = option("Random starts for non-linear parameters.", 32, least=1, of_shared=True)
    seed: int = option("Seed of every random number.", 0, least=0, of_step=True, of_shared=True)
    purpose: str = option(
        "What the verdict is for: predict; compensate, which tries the compensator too; or constants, which"
        " needs a standard error for every parameter.",
        "predict",
        choices=("predict", "compensate", "constants"),
        of_step=True,
        of_shared=True,
    )
    period: int | None = option(
        "Oscillator: rows in a period of the force, in steady state; 0: it does not repeat (default: looked"
        " for).",
        None,
        least=0,
    )
    oversampling: int = option("Oscillator: steps of integration to a sample.", 20, least=1)
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
