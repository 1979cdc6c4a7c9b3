"""Small files with known right answers, by the judge that lies beside them in `../shared/cases`.

The judge's document names for each case its checks: of the kinds "init", "fit" and "check". A fit or check
that reads the configuration of `init` fails where `init` proposes other columns.
"""

import json
import shlex
import shutil
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

from .._measure import Row, judged, noted

CASES = Path(__file__).resolve().parents[3] / "shared" / "cases"
WHAT = "settled Burgers, `fixed=0`, ramp then hold, magnetic loops, dead band: cases right"


def rows(quick: bool) -> list[Row]:
    """Of the fits and checks."""
    return cases_right(quick, ("fit", "check"), WHAT)


def cases_right(quick: bool, kinds: Sequence[str], what: str) -> list[Row]:
    """How many cases are right, of those with a check of these kinds; `quick`: of the first four."""
    if not (CASES / "key.json").is_file():
        return [noted(what, float("nan"), reason="no folder ../shared/cases beside the checkout")]
    judge = _judge()
    cases = json.loads((CASES / "key.json").read_text("utf-8"))["cases"]
    cases = [case for case in cases if any(check["do"] in kinds for check in case["checks"])]
    wrong = {
        case["case"]: told
        for case in cases[: 4 if quick else None]
        for told in _wrong(judge, case, kinds)
    }
    count = min(len(cases), 4) if quick else len(cases)
    for name, told in wrong.items():
        print(f"  {name}: {told}", file=sys.stderr, flush=True)
    names = f" (wrong: {', '.join(wrong)})" if wrong else ""
    row = judged(f"{what}, of {count}{names}", count - len(wrong), count, at_least=True)
    return [row._replace(met=None, reason="the first four only") if quick else row]


def _judge() -> ModuleType:
    """The judge as a module that runs this checkout."""
    module: Any = ModuleType("judge_of_cases")
    # Its last line runs it.
    main_of = (CASES / "judge.py").read_text("utf-8").rpartition("\nmain()")[0]
    exec(compile(main_of, str(CASES / "judge.py"), "exec"), vars(module))
    module.COMMAND = [sys.executable, *shlex.split("-m hysid")]
    return module


def _wrong(judge: Any, case: Any, kinds: Sequence[str]) -> Iterator[str]:
    """The first thing that is wrong with a case's checks of these kinds, if there is any."""
    with tempfile.TemporaryDirectory() as name:
        file = Path(name) / case["file"]
        shutil.copyfile(CASES / case["file"], file)
        ran: dict[Any, Any] = {}
        for check in case["checks"]:
            needs = any("{config}" in word for word in check.get("args", ()))
            told = judge.judge(check, file, Path(name), ran)
            if check["do"] in kinds and told:
                after = " (the configuration is that of init)" if needs else ""
                yield told[0].replace(name, "") + after
                return
