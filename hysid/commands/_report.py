"""`hysid report`."""

from ..reporting._specimens_page import report
from ._asked import Report
from ._console import Done, Progress, log


def run(asked: Report) -> Done:
    """The report of the folders; a fitted file stands for the folder of its name without the suffix."""
    folders = [
        one.with_suffix("")
        if one.is_file() and one.suffix and one.with_suffix("").is_dir()
        else one
        for one in asked.folders
    ]
    with Progress("report", later=True) as progress:
        found = report(folders, asked.out, log, progress)
    return Done(found, [found["file"]])
