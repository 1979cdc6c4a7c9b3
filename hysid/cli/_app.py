"""The command line. Options here, work in _jobs; progress on stderr, results on stdout."""

import json
import os
import shlex
import sys
import tempfile
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer

from ._commands import register
from ._compile_cache import keep_compiled
from ._config_file import SELECTION, Config, options_of, parameters_said, selection_options

app = typer.Typer(
    help="Hysteresis: from a test rig's CSV to a compensator that can be trusted.",
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


def _one_of(*choices: str) -> Callable[[str | None], str | None]:
    def check(value: str | None) -> str | None:
        if value is not None and value not in choices:
            raise typer.BadParameter(f"{value!r}; it is {' or '.join(choices)}")
        return value

    return check


File = Annotated[Path, typer.Argument(metavar="FILE", help="CSV file of the test rig.")]
Folder = Annotated[Path, typer.Argument(metavar="DIR", help="Folder of a fit.")]
Folders = Annotated[list[Path], typer.Argument(metavar="DIR...", help="Folders of fits.")]
Page = Annotated[Path | None, typer.Option("--out", help="Folder of the page on several fits.")]
Input = Annotated[
    list[str] | None,
    typer.Option("--input", help="Input column, by its exact header; repeat it for each channel."),
]
Step = Annotated[float | None, typer.Option(help="Constant input of creep or relaxation.")]
Hold = Annotated[bool, typer.Option("--hold", help="Creep or relaxation: where --input is held.")]
Output = Annotated[str, typer.Option("--output", help="Output column, by its exact header.")]
Time = Annotated[str | None, typer.Option(help="Time column.")]
InputTime = Annotated[str | None, typer.Option(help="The input's own clock, if not --time.")]
Dt = Annotated[float | None, typer.Option(help="Sampling step in seconds, without a time column.")]
Group = Annotated[str, typer.Option(help="COL[,COL]: independent sequences of one model.")]
Each = Annotated[str | None, typer.Option(help="COL: one fit for each of its values.")]
Where = Annotated[
    list[str] | None, typer.Option(help="COL=VALUE[,VALUE]: rows to use; repeatable.")
]
_NAN = _one_of("raise", "omit", "interpolate")
Nan = Annotated[
    str, typer.Option(callback=_NAN, help="raise, omit (mask rows without output) or interpolate.")
]
Segments = Annotated[
    str | None,
    typer.Option(callback=_one_of("auto"), help="auto: a new sequence where time goes back."),
]
Decimal = Annotated[
    str, typer.Option(callback=_one_of(".", ","), help="Decimal sign of the file, . or ,")
]
UnitsRow = Annotated[int | None, typer.Option(min=0, help="Line that holds units; 0 for none.")]
NaValues = Annotated[
    str, typer.Option(help="Words that mean a missing value, with commas between.")
]
InputUnit = Annotated[
    str | None, typer.Option(help="Unit of the input, where the header has none, or of --step.")
]
OutputUnit = Annotated[str | None, typer.Option(help="Unit of the output, likewise.")]
TestWhere = Annotated[
    list[str] | None, typer.Option(help="COL=VALUE[,VALUE] or COL%2=0: rows held out for testing.")
]
TestCycles = Annotated[
    int | None, typer.Option(min=1, help="Hold out the last N cycles of each sequence.")
]
TestTail = Annotated[
    float | None, typer.Option(help="Hold out this last fraction of each sequence.")
]
AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object.")]
Out = Annotated[Path, typer.Option("--out", help="Folder for the results.")]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Write over results that are there.")]
Seed = Annotated[int, typer.Option(min=0, help="Seed of everything random.")]


@app.command()
def demo(out: Out = Path("hysid-demo"), as_json: AsJson = False) -> None:
    """Fit, posterior, compensator and report on the shipped sponge record."""
    _say("hysid demo: loading JAX")
    jobs = _start()
    with _Progress() as progress:
        document = jobs.demo(out, _say, progress)
    backwards = document["inverse"]
    lines = [
        *_verdict_lines(document),
        f"Compensator, displacement -> force, over all rows: {backwards['rmse']:.3g} N rms"
        f" ({backwards['nrmse_percent']:.2g} % of the range), {backwards['flagged']} flagged.",
        f"Report: {document['report']}",
    ]
    _print(document, as_json, lines)


@app.command()
def check(
    file: File,
    output: Output,
    config: Config = None,
    input: Input = None,
    step: Step = None,
    hold: Hold = False,
    time: Time = None,
    dt: Dt = None,
    group: Group = "",
    each: Each = None,
    where: Where = None,
    nan: Nan = "raise",
    segments: Segments = None,
    decimal: Decimal = ".",
    units_row: UnitsRow = None,
    na_values: NaValues = "",
    input_unit: InputUnit = None,
    output_unit: OutputUnit = None,
    input_time: InputTime = None,
    as_json: AsJson = False,
) -> None:
    """Look at a record: rows, cycles, noise, and what stands against identifying a model."""
    options = selection_options(locals())
    jobs = _start()
    found = jobs.check(file, jobs.Selection(**options))
    lines = []
    for value, one in found.get("each", {"": found}).items():
        lines += [f"{each} = {value}"] if value else []
        lines += [one.pop("text"), *(f"Mind: {w}" for w in one["warnings"])]
    lines += [f"{each} = {v}: cannot be used. {e}" for v, e in found.get("failed", {}).items()]
    _print(found, as_json, lines)


@app.command()
def fit(
    file: File,
    output: Output,
    out: Out,
    config: Config = None,
    input: Input = None,
    step: Step = None,
    hold: Hold = False,
    time: Time = None,
    dt: Dt = None,
    group: Group = "",
    each: Each = None,
    where: Where = None,
    test_where: TestWhere = None,
    test_cycles: TestCycles = None,
    test_tail: TestTail = None,
    model: Annotated[str, typer.Option(help="auto, or NAME[,NAME].")] = "auto",
    initial: Annotated[
        str,
        typer.Option(
            callback=_one_of("auto", "negative", "positive", "demagnetised", "fit"),
            help="Memory before the first sample: auto, negative, positive, demagnetised, or fit.",
        ),
    ] = "auto",
    conditioning: Annotated[
        str,
        typer.Option(
            callback=_one_of("auto", "keep"),
            help="auto: leave the first cycle out where that predicts better; or keep.",
        ),
    ] = "auto",
    clocks: Annotated[
        str,
        typer.Option(
            callback=_one_of("auto", "keep"),
            help="auto: take out a lag between input and output, smooth a staircase; or keep.",
        ),
    ] = "auto",
    noise: Annotated[
        str,
        typer.Option(
            help="auto, or gaussian, student-t, ar1, arma11, growing, input, misfit with + between."
        ),
    ] = "auto",
    parameter: Annotated[
        list[str] | None,
        typer.Option(
            help='"E1 start=2 bounds=1,4", "b fixed=0", "K prior=normal(1, 0.1)", "E2 tied=2 * E1".'
        ),
    ] = None,
    starts: Annotated[
        int, typer.Option(min=1, help="Random starts for non-linear parameters.")
    ] = 32,
    nan: Nan = "raise",
    segments: Segments = None,
    decimal: Decimal = ".",
    units_row: UnitsRow = None,
    na_values: NaValues = "",
    input_unit: InputUnit = None,
    output_unit: OutputUnit = None,
    input_time: InputTime = None,
    seed: Seed = 0,
    allow_float32: Annotated[
        bool,
        typer.Option("--allow-float32", help="Fit in single precision; errors come out rough."),
    ] = False,
    overwrite: Overwrite = False,
    as_json: AsJson = False,
) -> None:
    """Fit models to a record, rank them on held-out parts, write the best to a folder."""
    options = selection_options(locals())
    jobs = _start(double=not allow_float32)
    document = jobs.fit(
        file, jobs.Selection(**options), out, overwrite=overwrite, say=_say, model=model,
        initial=initial, conditioning=conditioning, clocks=clocks, noise=noise, starts=starts,
        seed=seed, allow_float32=allow_float32, parameters=parameters_said(config, parameter),
    )  # fmt: skip
    _print(document, as_json, [*_verdict_lines(document), f"Results: {out}"])


@app.command()
def batch(
    pattern: Annotated[str, typer.Argument(metavar="'GLOB'", help="Files, as in 'data/*.csv'.")],
    config: Annotated[
        Path, typer.Option(help="TOML file: [selection], [fit], [parameters], as hysid fit has.")
    ],
    out: Out,
    scheduler: Annotated[str | None, typer.Option(help="ADDRESS of a Dask scheduler.")] = None,
    jobs: Annotated[int, typer.Option(min=1, help="Processes on this machine.")] = 1,
    resume: Annotated[
        bool, typer.Option("--resume/--no-resume", help="Leave alone what is there already.")
    ] = True,
    as_json: AsJson = False,
) -> None:
    """Fit every file of a pattern, each to a folder of its own; a bad one is named and stops nothing."""
    options = options_of(config, typer.main.get_command(app).commands["fit"])  # type: ignore[attr-defined]
    chosen = selection_options(options)
    others = {name: value for name, value in options.items() if name not in SELECTION}
    work = _start(double=not others["allow_float32"])
    from ..operations import _batch

    document = _batch.batch(
        pattern, work.Selection(**chosen), out, scheduler=scheduler, jobs=jobs, resume=resume,
        say=_say, **others,
    )  # fmt: skip
    before = f", {document['skipped']} of them before" if document["skipped"] else ""
    lines = [f"{document['fitted']} fitted{before}; {len(document['failed'])} not."]
    lines += [f"{name}: {why}" for name, why in document["failed"].items()]
    _print(document, as_json, [*lines, f"Table: {document['file']}"])


@app.command()
def predict(
    folder: Folder,
    file: File,
    inverse: Annotated[
        bool, typer.Option("--inverse", help="Run the compensator: input from output.")
    ] = False,
    where: Where = None,
    nan: Annotated[
        str | None, typer.Option(callback=_NAN, help="As in fit; by default what the fit used.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Run a fitted model, or its compensator, over a file with the same columns."""
    changes = {"where": tuple(where)} if where else {}
    changes |= {"nan": nan} if nan else {}
    found = _start().predict(folder, file, inverse=inverse, changes=changes)
    compared = "nothing measured to compare with"
    if found["rmse"] is not None:
        compared = f"{found['rmse']:.4g} rms, {found['nrmse_percent']:.3g} % of the range"
    lines = [f"{compared}; {found['flagged']} of {found['rows']} rows flagged", found["file"]]
    _print(found, as_json, [*(f"Mind: {note}" for note in found["notes"]), *lines])


@app.command()
def sample(
    folder: Folder,
    steps: Annotated[
        int | None,
        typer.Option(help="Steps of each ensemble, in all; by default until they agree."),
    ] = None,
    ensembles: Annotated[int, typer.Option(help="Independent ensembles.")] = 4,
    walkers: Annotated[int | None, typer.Option(help="Walkers of each ensemble.")] = None,
    method: Annotated[
        str, typer.Option(callback=_one_of("emcee", "nuts"), help="emcee, or nuts (an extra).")
    ] = "emcee",
    resume: Annotated[bool, typer.Option("--resume", help="Go on from the chains kept.")] = False,
    seed: Seed = 0,
    as_json: AsJson = False,
) -> None:
    """Draw from the posterior of a fit."""
    jobs = _start()
    chosen = {"steps": steps, "walkers": walkers, "ensembles": ensembles, "seed": seed}
    try:
        with _Progress() as progress:
            found = jobs.sample(folder, **chosen, method=method, resume=resume, progress=progress)
    except KeyboardInterrupt:
        if method == "emcee":
            given = [f"--{name} {value}" for name, value in chosen.items() if value is not None]
            _say(f"To go on: hysid sample {shlex.quote(str(folder))} --resume {' '.join(given)}")
        raise
    lines = [f"{'parameter':24}{'mean':>12}{'sd':>12}{'5 %':>12}{'95 %':>12}{'R-hat':>8}{'ESS':>8}"]
    lines += [
        f"{p['name']:24}{p['mean']:12.4g}{p['sd']:12.3g}{p['q05']:12.4g}{p['q95']:12.4g}"
        f"{p['rhat']:8.3f}{p['ess']:8.0f}{''.join(f'  {words}' for words in p['words'])}"
        for p in found["parameters"]
    ]
    lines += [f"Mind: {note}" for note in found["notes"]]
    if not found["converged"]:
        lines.append(
            "Not converged: R-hat above 1.01, or too few draws; leave --steps out, or take more."
        )
    _print(found, as_json, lines)


@app.command()
def compare(
    folders: Folders,
    change: Annotated[
        bool, typer.Option("--change", help="One model on different data: what changed?")
    ] = False,
    margin: Annotated[
        float, typer.Option(help="With --change: the part of a value that counts as a change.")
    ] = 0.05,
    times: Annotated[
        str, typer.Option(help="With --change: T,T,... when each fit's data were taken.")
    ] = "",
    as_json: AsJson = False,
) -> None:
    """Rank models of the same data, or with --change see what became of one model's parameters."""
    _start()
    from ..operations import _compare

    if change:
        document = _compare.change(folders, margin, _compare.parse_times(times))
        lines = _compare.change_lines(document)
    else:
        document = _compare.compare(folders)
        lines = _compare.comparison_lines(document)
    _print(document, as_json, lines)


@app.command()
def report(folders: Folders, page: Page = None, as_json: AsJson = False) -> None:
    """Write DIR/report.html, one page that needs nothing else; of several fits, one that compares them."""
    _start()
    from ..reporting import _specimens_page as _report_many

    found = _report_many.report(folders, page, _say)
    _print(found, as_json, [found["file"]])


register(app)


def main() -> None:
    """Run the command line: exit 0 good, 2 the user's input is at fault, 1 a bug of ours."""
    interrupted = 130  # what newer typers return then; older ones raise Abort
    try:
        code = app(sys.argv[1:] or ["--help"], prog_name="hysid", standalone_mode=False)
    except (KeyboardInterrupt, typer.Abort):
        code = interrupted
    except Exception as error:
        _fail(*_explain(error))
    if code == interrupted:
        _fail("Interrupted. What was written so far is whole.", code)


def _explain(error: Exception) -> tuple[str, int]:
    # Known by its method: newer typers bring their own click, older ones need the package.
    if (usage := getattr(error, "format_message", None)) is not None:
        context = getattr(error, "ctx", None)
        hint = f" See: {context.command_path} --help" if context is not None else ""
        return f"{usage().rstrip('.')}.{hint}", 2
    from hysteresis import InputError

    if isinstance(error, InputError):
        return str(error), 2
    if isinstance(error, OSError):
        return f"{error.filename or 'the disk'}: {error.strerror or error}.", 2
    with tempfile.NamedTemporaryFile(
        "w", suffix=".txt", prefix="hysid-", delete=False, encoding="utf-8"
    ) as log:
        traceback.print_exception(error, file=log)
    said = ": ".join([type(error).__name__, *str(error).splitlines()[:1]])
    return f"This is a bug in hysid, not your doing ({said}). Details: {log.name}", 1


def _fail(message: str, code: int) -> NoReturn:
    print(f"hysid: {message}", file=sys.stderr)
    raise SystemExit(code)


def _start(double: bool = True) -> Any:
    """Load JAX in double precision, one thread for small matrices, compiled code kept."""
    for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(variable, "1")
    keep_compiled()
    import jax

    jax.config.update("jax_enable_x64", double)
    from ..operations import _fit_and_predict as _jobs

    return _jobs


def _verdict_lines(document: dict[str, Any]) -> list[str]:
    lines = [f"{document['verdict']['level']}: {document['model']}"]
    return lines + [f"  {reason}" for reason in document["verdict"]["reasons"]]


def _print(document: dict[str, Any], as_json: bool, lines: list[str]) -> None:
    if as_json:
        from identify.internal import plain

        print(json.dumps(plain(document), ensure_ascii=False), flush=True)
    else:
        print("\n".join(lines), flush=True)


def _say(line: str) -> None:
    print(line, file=sys.stderr, flush=True)


class _Progress:
    """A progress bar on a terminal, a line every tenth elsewhere; both on stderr."""

    def __enter__(self) -> "_Progress":
        self._bar: Any = None
        self._tenth = -1
        return self

    def __call__(self, done: int, total: int, text: str) -> None:
        if sys.stderr.isatty():
            if self._bar is None:
                from rich.console import Console
                from rich.progress import Progress

                self._bar = Progress(console=Console(stderr=True))
                self._bar.start()
                self._task = self._bar.add_task("sampling", total=total)
            self._bar.update(self._task, completed=done, total=total, description=text)
        elif (tenth := 10 * done // total) != self._tenth:
            self._tenth = tenth
            _say(f"sampling: {done} of {total}, {text}")

    def __exit__(self, *_: object) -> None:
        if self._bar is not None:
            self._bar.stop()
