"""What each command is asked for: the fields are its arguments and options, the docstring is its help.

`run` does it, for the command line and for Python. No import of this module loads JAX, because `--help`
reads it.
"""

import re
from collections.abc import Mapping
from dataclasses import Field, dataclass, field, fields
from datetime import date
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any, ClassVar, dataclass_transform

import typer

from hysteresis import InputError

from ..intake._options import (
    FIELDS,
    FIT_FIELDS,
    HELD_OUT,
    OF_READING,
    OF_SPECTRA,
    FitOptions,
    has_shape,
    is_given,
    option,
    option_words,
)
from ._console import Done, log

PAPERS = ("tsuji2014", "kim2018")
CHAINS = "chains.npz"
"""What `hysid sample` keeps."""


def selecting(*names: str, optional: bool = False, needs_input: bool = False) -> Any:
    """A field of these selecting options, or of all, as a mapping ready for `Selection(**selection)`.

    `optional`: nothing has a default, and only what was given is in it. `needs_input`: `--input` has to be.
    """
    how = {"optional": optional, "needs_input": needs_input}
    return field(default_factory=dict, metadata={"selection": names or tuple(FIELDS), "how": how})


_file = partial(option, "CSV file of the test rig.", argument=True, metavar="FILE")
_folder = partial(option, "Folder of a fit.", argument=True, metavar="DIR")
_folders = partial(option, "Folders of fits.", argument=True, metavar="DIR...")
_config = partial(
    option,
    "TOML file of options: [selection], [fit], [parameters]. Options given here override it.",
    None,
    config=True,
)
overwriting = partial(option, "Overwrite existing results.", False)
_of_card = partial(option, of=("card", "a material card (--to)"))
_of_program = partial(option, of=("program", "a compensator to write"))
_of_c = partial(option, of=("compiled", "a compensator to write in C"))
seeding = partial(option, "Seed of every random number.", 0, least=0)


@dataclass_transform(kw_only_default=True, frozen_default=True)
@dataclass(frozen=True, kw_only=True)
class Command:
    """What every command has. `does`: its function, where that is not `run` of the module of its name.
    `jax`: whether that computes."""

    does: ClassVar[str] = ""
    jax: ClassVar[bool] = True
    as_json: bool = option("Print one JSON object.", False, flag="--json")

    @classmethod
    def title(cls) -> str:
        """Its name on the command line."""
        return re.sub("(?<=[a-z])(?=[A-Z])", "-", cls.__name__).lower()

    @property
    def words(self) -> list[str]:
        """What asks for it on the command line, without "hysid" and the name of its group."""
        words = [self.title()]
        for one in fields(self):
            value, chosen = getattr(self, one.name), "selection" in one.metadata
            known = FIELDS.values() if chosen else [one]
            words += option_words(known, value if chosen else {one.name: value})
        return words

    def __init_subclass__(cls) -> None:
        dataclass(frozen=True, kw_only=True)(cls)

    def run(self) -> Done:
        """Do it; this loads what the command needs. Raises `InputError` for an option without what it is
        of, and for a file read and written."""
        for one in fields(self):
            needed, called = one.metadata.get("of", ("", ""))
            words = option_words([one], {one.name: getattr(self, one.name)})
            if called and words and not getattr(self, needed):
                fix = "Give both, or leave it out."
                raise InputError(
                    "bad-option", f"{words[0]} has no effect without {called}.", fix=fix
                )
        given = [getattr(self, one.name) for one in fields(self)]
        files = [one.resolve() for one in given if isinstance(one, Path) and one.is_file()]
        for file in files:
            if files.count(file) > 1:
                said, fix = f"{file.name} would be read and written.", "Name another file to write."
                raise InputError("would-overwrite", said, place=str(file.parent), fix=fix)
        module, function = (self.does or f"commands._{type(self).__name__.lower()}:run").split(":")
        return getattr(import_module(f"hysid.{module}"), function)(self)


class Demo(Command):
    """Run fit, posterior, compensator and report on a shipped record.

    The verdict is printed as soon as the fit is made.
    """

    out: Path = option("Folder for the results.", Path("hysid-demo"))

    def __post_init__(self) -> None:
        log("hysid demo: loading JAX")  # before anything of it is


class Init(Command):
    """Guess columns, units and cycles of a file; write its .toml.

    Give the columns that you know as options; hysid guesses the others, and what to hold out.
    """

    file: Path = _file()
    selection: dict[str, Any] = selecting(optional=True)
    out: Path | None = option(
        "Configuration to write (default: FILE's .toml).", None, metavar="FILE.toml"
    )
    overwrite: bool = overwriting()


class Check(Command):
    """Describe a record and what makes a model hard to identify.

    Without columns, and without --config, the options are those of FILE's .toml.
    """

    file: Path = _file()
    selection: dict[str, Any] = selecting(*(name for name in FIELDS if name not in HELD_OUT))
    config: Path | None = _config()


class Fit(FitOptions, Command):
    """Fit models to a record, judge the best one, and write it to a folder.

    FILE alone is enough where its columns are plain: hysid chooses them, says why, and keeps its choice in
    FILE's .toml, whose options it takes from then on. Models are ranked by their errors on rows that were
    held out from the fit. Several files are specimens that share parameters (--share).
    """

    file: Path = _file()
    others: list[Path] | None = option(
        "Files of further specimens.", None, argument=True, metavar="[FILE...]"
    )
    selection: dict[str, Any] = selecting()
    out: Path | None = option("Folder for the results (default: FILE without its suffix).", None)
    config: Path | None = _config()
    overwrite: bool = overwriting()

    @property
    def of_identify(self) -> dict[str, Any]:
        """The options of `identify.fit`."""
        from ..intake._own_config import parameters_said  # late: it loads NumPy

        found = {
            name: value
            for name, one in FIT_FIELDS.items()
            if name != "parameter"
            and (is_given(one, value := getattr(self, name)) or name not in (*OF_SPECTRA, "share"))
        }
        found["parameters"] = parameters_said(self.config, self.parameter)
        if self.like:
            from identify import load  # late: it loads JAX

            found["like"] = [load(folder) for folder in self.like]
        return found


class OnNewData(Command):
    """A command on a fit and a file with the columns that the fit used."""

    folder: Path = _folder()
    file: Path = _file()
    selection: dict[str, Any] = selecting(
        "where", "nan", "segments", "known", *OF_READING, optional=True
    )


class Predict(OnNewData):
    """Run a fitted model, or its compensator, over a file.

    The file has the columns that the fit used. --where, --nan and how the file is read are by default those
    of the fit.
    """

    inverse: bool = option("Run the compensator: estimate the input from the output.", False)
    steady: bool = option(
        "Oscillator: the force has run so often that the motion repeats itself.", False
    )


class Qualify(OnNewData):
    """Judge a fit's compensator on data it has not seen.

    The verdict is PASS, CAUTION or FAIL; FAIL, and exit status 2, where the compensator does not meet
    --max-error or --rate. --where, --nan and how the file is read are by default those of the fit.
    """

    max_error: float | None = option(
        "Largest error that is allowed, in the unit of the input.", None
    )
    rate: float | None = option("Samples per second that the compensator must keep up with.", None)
    target: str = option(
        "What must keep up with --rate: the header, or plain Python here.",
        "c",
        choices=("c", "python"),
        of=("rate", "--rate"),
    )
    mhz: float | None = option(
        "Clock of the processor that runs the header; an operation is taken for a cycle.",
        None,
        least=1e-6,
        of=("rate", "--rate"),
    )
    guarantee: float | None = option(
        "Probability, as 0.9, with which a band is to hold a whole new run; its width is found from the"
        " runs or cycles of FILE.",
        None,
    )


class Monitor(OnNewData):
    """Run a fit's compensator over a log, and let it recalibrate itself where the input is known.

    It says whether a calibration is needed now, why, and how much accuracy is lost until then. --where,
    --nan and how the file is read are by default those of the fit.
    """

    reference: str | None = option(
        "Column of the known inputs, empty where they are not known (default: the fit's input).",
        None,
    )
    drift: float = option(
        "Standard deviation of the drift of the zero that is expected, in the unit of the output per unit"
        " of time.",
        0.0,
        least=0.0,
    )


class Export(Command):
    """Write a fit's compensator as C99, for plain Python, or for a target around the C99.

    None of them needs JAX.
    """

    folder: Path = _folder()
    c: Path | None = option("Write a C99 header.", None, metavar="FILE.h")
    runtime: Path | None = option("Write a file for compensate.runtime.", None, metavar="FILE.json")
    to: tuple[str, Path] | None = option(
        "Write OUT for a target: c, runtime, arduino, ros2, mujoco, sklearn, onnx, fmu, fmu3; or the"
        " material card of a relaxing model: abaqus, apdl, mpl, comsol, ls-dyna, openradioss, calculix,"
        " febio, opensees.",
        None,
        metavar="TARGET OUT",
    )
    poisson: float = _of_card("Material card: Poisson's ratio, below 0.5.", 0.45)
    shear: bool = _of_card("Material card: the fitted modulus is a shear modulus.", False)
    single: bool = _of_c("Use float instead of double in C.", False, flag="--float")
    fixed: bool = _of_c("Use integers (fixed point): Preisach grids with --to arduino.", False)
    depth: int | None = _of_program(
        "Reversals a Preisach model stores (default: 64, or as needed).", None, least=3
    )
    limits: tuple[float, float] | None = _of_program(
        "LOW HIGH: readings beyond these limits are clipped to them.", None
    )
    beyond: str = _of_program(
        "What becomes of estimates beyond the trained inputs: limit, nan or free. Their status is"
        " EXTRAPOLATED in any case.",
        "limit",
        choices=("limit", "nan", "free"),
    )
    start: str = _of_program(
        "What is known of the memory before the first reading: unknown (RUN_IN until the readings have"
        " replaced it) or known (the model's virgin state).",
        "unknown",
        choices=("unknown", "known"),
    )
    date: str = _of_program(
        "Date of the data (default: of the fitted file).", "", metavar="YYYY-MM-DD"
    )

    @property
    def targets(self) -> dict[str, Path]:
        """What is to be written, by the name of its target."""
        named = {"c": self.c, "runtime": self.runtime, **dict([self.to] if self.to else [])}
        return {target: path for target, path in named.items() if path is not None}

    @property
    def card(self) -> bool:
        """Whether a material card is to be written, which is no program."""
        from compensate.export._cards import CARDS  # late: it loads NumPy

        return self.to is not None and self.to[0] in CARDS

    @property
    def program(self) -> bool:
        """Whether a compensator is."""
        return not self.card

    @property
    def compiled(self) -> bool:
        """Whether one is that holds numbers of a type."""
        return self.program and self.targets.keys() != {"runtime"}

    def __post_init__(self) -> None:
        if not self.targets:
            raise typer.BadParameter(
                "nothing to write; give --c FILE.h, --runtime FILE.json or --to TARGET OUT"
            )
        if self.fixed and self.single:
            raise typer.BadParameter("give --float or --fixed, not both")
        if len(self.targets) < sum(x is not None for x in (self.c, self.runtime, self.to)):
            raise typer.BadParameter("--to names what --c or --runtime names; give one of them")
        try:
            date.fromisoformat(self.date or "1970-01-01")
        except ValueError:
            raise typer.BadParameter(f"--date {self.date!r} is not YYYY-MM-DD") from None


class Sample(Command):
    """Sample the posterior of a fit's parameters."""

    folder: Path = _folder()
    steps: int | None = option(
        "Total MCMC steps per ensemble (default: run until R-hat < 1.01).", None
    )
    ensembles: int = option("Independent ensembles.", 4)
    walkers: int | None = option(
        "Walkers per ensemble (default: from the number of parameters).", None
    )
    resume: bool = option("Resume from the saved chains.", False)
    overwrite: bool = overwriting()
    seed: int = seeding()


class Design(Command):
    """Find the multisine that would tell the hysteresis of a fitted oscillator best.

    Forces are a quarter to four times the fitted one, in bands about the resonance; others are for
    identify.design_excitation. Each candidate's standard errors are those that one period in steady state
    would leave, relative to the values. DIR/excitation.csv has one period of the best one within the fitted
    displacements.
    """

    folder: Path = _folder()
    max_displacement: float | None = option("Largest displacement that the rig allows.", None)
    seed: int = seeding()


class Compare(Command):
    """Rank models of the same data, or test for a change.

    With --change the folders are two fits of one model to different data: before, after. With --loops they
    are two groups of specimens: folders of hysid fit --each.
    """

    folders: list[Path] = _folders()
    loops: bool = option("Test which figures of the loops differ between two groups.", False)
    change: bool = option("Test whether one model's parameters differ between data sets.", False)
    margin: float = option(
        "With --change: the relative difference that counts as a change.",
        0.05,
        of=("change", "--change"),
    )

    def __post_init__(self) -> None:
        if self.loops and self.change:
            raise typer.BadParameter("give --loops or --change, not both")


class Report(Command):
    """Write an HTML report of one fit or of several.

    DIR/report.html is self-contained. For several fits hysid also writes a page that compares them. For a
    folder the fitted FILE may be given, where the folder has its name without the suffix.
    """

    folders: list[Path] = _folders()
    out: Path | None = option("Folder for the page that compares several fits.", None)


class Batch(Command):
    """Fit every file that matches a pattern.

    Each fit gets its own folder in --out. A file that cannot be fitted is named; the others go on.
    """

    pattern: str = option("Files, as in 'data/*.csv'.", argument=True, metavar="'GLOB'")
    config: Path = option(
        "TOML file with the options of hysid fit: [selection], [fit], [parameters]."
    )
    out: Path = option("Folder for the results.")
    scheduler: str | None = option("Dask scheduler that runs the fits.", None, metavar="ADDRESS")
    jobs: int = option("Processes on this machine.", 1, least=1)
    resume: bool = option("Skip files that are fitted already.", True, flag="--resume/--no-resume")
    fit: Fit  # made of the file `config`

    def __post_init__(self) -> None:
        if self.scheduler and self.jobs > 1:
            raise typer.BadParameter("give --jobs or --scheduler, not both")


class Reproduce(Command):
    """Reproduce a paper's tables with virtual laboratories."""

    paper: str = option(f"{' or '.join(PAPERS)}.", argument=True, metavar="PAPER", choices=PAPERS)
    out: Path | None = option("Folder for the results (default: hysid-PAPER).", None)
    rigs: int | None = option(
        "Number of virtual laboratories (default: 60 for tsuji2014, 20 for kim2018).", None, least=2
    )
    seed: int = option("Seed of the first laboratory.", 0, least=0)
    ours: bool = option(
        "Also use the methods of hysid, which takes longer.", True, flag="--ours/--no-ours"
    )
    epochs: int | None = option(
        "Training epochs of kim2018's network (default: the paper's 1,000).",
        None,
        least=1,
        of=("trains", "the paper kim2018"),
    )
    quick: bool = option("Fewer laboratories and epochs: five minutes on two cores.", False)
    overwrite: bool = overwriting()

    @property
    def trains(self) -> bool:
        """Whether the paper trains a network."""
        return self.paper == PAPERS[1]


class Warm(Command):
    """Compile ahead what these fits and their compensators run; without any, each law alone.

    hysid compiles a model when a long record is worth it, and keeps that in the cache folder. On a machine
    that has to answer at once this command does it before.
    """

    fits: list[Path] | None = option("Folders of fits.", None, argument=True, metavar="[DIR]...")


def fields_of(asked: type[Command], values: Mapping[str, Any]) -> dict[str, Any]:
    """Values as the command line has them, as the fields of what is asked for."""
    found: dict[str, Any] = {}
    for one in fields(asked):
        if (names := one.metadata.get("selection")) is not None:
            given = as_fields({name: values[name] for name in names if name in values})
            optional = one.metadata["how"]["optional"]
            found[one.name] = {k: v for k, v in given.items() if v or not optional}
        elif one.name in values:
            found[one.name] = _value(one, values[one.name])
    return found


def as_fields(values: Mapping[str, Any]) -> dict[str, Any]:
    """Values as the command line has them, as `Selection` takes them: tuples for lists and joined words."""
    found = {name: _value(FIELDS[name], value) for name, value in values.items()}
    if "input" in found and len(found["input"]) < 2:
        found["input"] = next(iter(found["input"]), None)
    return found


def _value(one: Field[Any], value: Any) -> Any:
    if one.metadata.get("repeated"):
        return tuple(value or ())
    if not one.metadata.get("joined"):
        return value
    text = value if isinstance(value, str) else ",".join(value or ())
    words = tuple(filter(None, text.split(",")))
    if one.type != tuple[float, ...]:
        return words
    if not has_shape(one, words):
        shape = one.metadata["metavar"]
        raise typer.BadParameter(f"--{one.name} is {shape}: numbers, such as 2,20")
    return tuple(map(float, words))
