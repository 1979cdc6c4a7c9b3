"""A worked example for the help text of each command."""

from collections.abc import Iterator

import typer

SPONGE = "--input 'force (N)' --output 'displacement (mm)'"

EXAMPLES = {
    "demo": "hysid demo --out demo",
    "init": "hysid init run.csv",
    "check": f"hysid check run.csv {SPONGE} --time 'time (s)'",
    "fit": f"hysid fit run.csv {SPONGE} --time 'time (s)' --test-cycles 1 --out sponge",
    "batch": "hysid batch 'data/*.csv' --config sponge.toml --out all",
    "predict": "hysid predict sponge new.csv --inverse",
    "sample": "hysid sample sponge --ensembles 4",
    "compare": "hysid compare sponge foam",
    "report": "hysid report sponge",
    "export": "hysid export sponge --c sponge.h --runtime sponge.json",
    "qualify": "hysid qualify sponge new.csv --max-error 2 --rate 1000",
    "reproduce": "hysid reproduce tsuji2014 --out tsuji2014",
    "bench": "hysid bench preisach --quick",
    "armor view": "hysid armor view tsuji2014",
    "microchannel train": "hysid microchannel train run.csv --input 'layer 1 (V)' --force 'force (N)'"
    " --time 'time (s)' --test-tail 0.2 --out sensor",
    "microchannel estimate": "hysid microchannel estimate sensor new.csv",
    "datasets list": "hysid datasets list",
    "datasets fetch": "hysid datasets fetch steel-coupon --out steel",
}
"""By the words that call the command."""


def with_examples(app: typer.Typer) -> typer.Typer:
    """The same app; the help of each command of the table ends with its example."""
    for words, info in _commands(app):
        if example := EXAMPLES.get(words):
            info.epilog = f"Example:\n\n\b\n  {example}"  # \b: a line that is not wrapped
    return app


def _commands(
    app: typer.Typer, before: str = ""
) -> Iterator[tuple[str, "typer.models.CommandInfo"]]:
    for info in app.registered_commands:
        name = info.name or getattr(info.callback, "__name__", "").replace("_", "-")
        yield f"{before}{name}", info
    for group in app.registered_groups:
        if group.typer_instance is not None:
            yield from _commands(group.typer_instance, f"{before}{group.name} ")
