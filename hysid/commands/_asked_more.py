"""What commands about sensors, data sets and the page are asked for, as in `_asked`."""

from functools import partial
from pathlib import Path
from typing import Any

import typer

from .._catalogue import SHIPPED
from ..intake._options import FIELDS, HELD_OUT, OF_READING, option
from ._asked import Command, overwriting, seeding, selecting

_catalogue = partial(
    option,
    "Another catalogue, for example the one of your laboratory.",
    SHIPPED,
    metavar="FILE",
    show_default=False,
)
_sponge = partial(option, "Fit of the cover, in either direction.", metavar="DIR")
_shape = partial(option, "The shell: a TOML file, or a mesh (STL, OBJ, ...).", metavar="FILE")
_sessions = partial(option, "CSV files; each is one session.", argument=True, metavar="FILE...")
_config = partial(
    option, "TOML file of options: [selection]. Options given here override it.", None, config=True
)
_of_force = partial(option, of=("force", "--force"))
_of_place = partial(option, of=("place", "--place"))
_epochs = partial(option, "Epochs per network (default: 20,000 steps of 64 rows).", None, least=1)


class Loops(Command):
    """Tell the figures of every loop: energy, width, stiffness, damping, each with an error.

    Loops over a magnetic or an electric field have coercive field, remanence, saturation and loss. FILE
    alone is enough where its columns are plain, as for hysid fit.
    """

    does, jax = "commands._loop_table:run", False
    file: Path = option("CSV file of the test rig.", argument=True, metavar="FILE")
    selection: dict[str, Any] = selecting(*(name for name in FIELDS if name not in HELD_OUT))
    kind: str | None = option(
        "What the loops are of: mechanical, magnetic, ferroelectric or plain (default: by the units).",
        None,
    )
    csv: Path | None = option(
        "Write the table: a row a loop, and each figure with its error.", None, metavar="FILE.csv"
    )
    config: Path | None = _config()


class Distortion(Command):
    """Tell how much of a periodic test's outputs is linear, distortion and noise, by band and level.

    The input repeats itself, such as a multisine of a shaker; several realisations and levels are rows with
    different values of --group. `identify.fit_feedback` finds what makes the distortion.
    """

    does = "commands._distortion:run"
    file: Path = option("CSV file of the test rig.", argument=True, metavar="FILE")
    selection: dict[str, Any] = selecting(
        "input", "time", "dt", "group", *OF_READING, needs_input=True
    )
    output: tuple[str, ...] = option("Output columns.", joined=True, metavar="COL[,COL]")
    period: int | None = option(
        "Rows of a period (default: looked for in the first input).", None, least=2, metavar="N"
    )
    bands: int = option("Bands of frequency, of equally many excited lines.", 4, least=1)


class Datasheet(Command):
    """Write the data sheet of a sensor: one page of PDF, and the same as HTML.

    Sensitivity, zero, non-linearity, hysteresis, repeatability, zero return, drift, creep and recovery,
    resolution, settling, and with --condition the coefficients, by the terms of IEC 61298-2 and ISO 376.
    The input is what the sensor measures, the output its reading; each file is one run or more.
    """

    does = "commands._data_sheet:run"
    files: list[Path] = option("CSV files of the runs.", argument=True, metavar="RUNS...")
    selection: dict[str, Any] = selecting(
        *(name for name in FIELDS if name not in (*HELD_OUT, "each", "step", "hold"))
    )
    out: Path | None = option(
        "The page without its suffix (default: the first file's name, and -datasheet).",
        None,
        metavar="PAGE",
    )
    config: Path | None = _config()
    overwrite: bool = overwriting()


class Calibrate(Command):
    """Calibrate sensor, cover and frame with presses at known points.

    The table has columns Fx to Mz (what the sensor read), force (of the gauge), x, y, z (the touched point)
    and press; time and displacement where they were measured. The folder gets the calibrated armor, for
    `hysid armor solve --armor DIR`, and armor.json, which runs without JAX.
    """

    does = "commands._armor:calibrate"
    file: Path = option("Presses at known points.", argument=True, metavar="PRESSES.csv")
    out: Path = option("Folder for the results.")
    sponge: Path = _sponge()
    shape: Path = _shape()
    overwrite: bool = overwriting()


class Solve(Command):
    """Find the contacts behind wrenches: points, covariances and statuses.

    The folder gets contacts.csv, touches.json, which `hysid armor view` shows, and armor.json, which runs
    without JAX.
    """

    does = "commands._armor:solve"
    file: Path = option(
        "Columns Fx, Fy, Fz, Mx, My, Mz, time.", argument=True, metavar="WRENCHES.csv"
    )
    out: Path = option("Folder for the results.")
    sponge: Path | None = _sponge(None)
    shape: Path | None = _shape(None)
    calibrated: Path | None = option(
        "Calibrated armor, instead of --sponge and --shape.", None, flag="--armor", metavar="DIR"
    )
    stream: bool = option("The rows are one stream: the cover has its history.", False)
    overwrite: bool = overwriting()


class View(Command):
    """Write DIR/armor.html, a replay of the contacts in 3D."""

    does = "commands._armor:view"
    folder: Path = option(
        "Folder with touches.json, as hysid armor solve writes it.", argument=True, metavar="DIR"
    )


class Train(Command):
    """Train a soft sensor on CSV files; write it to a folder.

    The sensor learns to estimate force, place or position.
    """

    does = "commands._microchannel:train"
    files: list[Path] = _sessions()
    out: Path = option("Folder for the sensor.")
    selection: dict[str, Any] = selecting(
        "input", "time", "dt", "group", "where", "test_where", "test_cycles", "test_tail", "nan",
        "segments", "decimal", "units_row", "na_values", "input_unit", needs_input=True,
    )  # fmt: skip
    force: str | None = option("COL: force to learn.", None)
    place: str | None = option(
        "COL: name of the pressed place, empty where nothing is pressed.", None
    )
    position: tuple[str, ...] = option(
        "COL: one coordinate of the pressed point; repeat it for each.", (), repeated=True
    )
    test_file: list[Path] | None = option(
        "Hold out this whole session for testing; repeatable.", None
    )
    kind: str = _of_force(
        "Force model: network, structured, or auto (the better of them).",
        "auto",
        choices=("auto", "network", "structured"),
    )
    epochs: int | None = _epochs(of=("force", "--force"))
    members: int = _of_force(
        "Number of networks; each is trained with a different part held out.", 5, least=2
    )
    places: str = _of_place("NAME[,NAME]: names of the places (default: those in the files).", "")
    method: str = _of_place(
        "How places are told apart: gaussian (of log ratios), or neighbours, as the paper does.",
        "gaussian",
        choices=("gaussian", "neighbours"),
    )
    noise: float | None = option(
        "Standard deviation of a reading (default: estimated from the data).", None
    )
    range: tuple[float, float] | None = option(
        "LOW HIGH of the converter: readings there are SATURATED.", None
    )
    seed: int = seeding()
    resume: bool = _of_force("Resume from the checkpoint in --out.", False)
    overwrite: bool = overwriting()

    def __post_init__(self) -> None:
        if self.range is not None and not self.range[0] < self.range[1]:
            raise typer.BadParameter("--range is LOW HIGH, with LOW below HIGH")


class TrainPairs(Command):
    """Train an estimator of the forces on several places at once; write it to a folder.

    Each place is learnt from the sequences that press it alone. Sequences that press several judge it.
    The folder also gets runtime.json, which runs without JAX.
    """

    does = "commands._pairs:train_pairs"
    files: list[Path] = _sessions()
    out: Path = option("Folder for the estimator.")
    selection: dict[str, Any] = selecting(
        "input", "time", "dt", "group", "where", "test_where", "nan", "segments", "decimal",
        "units_row", "na_values", "input_unit", needs_input=True,
    )  # fmt: skip
    force: tuple[str, ...] = option(
        "COL: the force on one place; repeat it for each.", repeated=True
    )
    epochs: int | None = _epochs()
    noise: float = option("Least standard deviation of a reading.", 0.0, least=0)
    seed: int = seeding()
    overwrite: bool = overwriting()


class Estimate(Command):
    """Run a trained sensor over a file.

    If the file has the true values too, the errors are printed. Of a fit between a force and a reading
    hysid predict --inverse does the same.
    """

    does = "commands._microchannel:estimate"
    folder: Path = option("Folder of a trained sensor, or of pairs.", argument=True, metavar="DIR")
    file: Path = option("CSV file with the sensor's channels.", argument=True, metavar="FILE")
    selection: dict[str, Any] = selecting("where", *OF_READING, optional=True)
    out: Path | None = option("CSV file to write (default: DIR/estimated-FILE.csv).", None)


class Studio(Command):
    """Show a page in the browser to look at measurements, fit them and export compensators.

    The page is on this machine alone, and its address opens it once; opening it again prints another. It
    works on one folder, on the same files as the other commands; nothing is uploaded anywhere.
    """

    does, jax = "studio._run:run", False
    files: list[Path] | None = option(
        "Files of one folder, or a folder (default: the current one).",
        None,
        argument=True,
        metavar="[FILE...]",
    )
    port: int = option("Port of the page; 0 for any that is free.", 0, least=0, most=65535)
    browser: bool = option("Open the page in a browser.", True, flag="--browser/--no-browser")


class List(Command):
    """List every data set with its size, licence and kind."""

    does, jax = "commands._datasets:listed", False
    catalogue: Path = _catalogue()


class Fetch(Command):
    """Download a data set and check it.

    hysid writes a CSV file and a configuration for hysid fit.
    """

    does, jax = "commands._datasets:fetch", False
    name: str = option("Name, as hysid datasets list prints it.", argument=True, metavar="NAME")
    out: Path = option("Folder for NAME.csv and NAME.toml.", Path("."))
    accept: bool = option("Accept files whose checksum is not known.", False)
    overwrite: bool = option("Overwrite existing files.", False)
    catalogue: Path = _catalogue()
