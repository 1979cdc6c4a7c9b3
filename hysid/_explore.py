"""`hysid.explore`: a record in a notebook, with linked plots and rows chosen by brushing."""

from typing import Any

import numpy as np
from jaxtyping import Bool

from hysteresis import Record

from ._packages import check_extra
from ._plots_script import script, styles
from .figures._format import axes_of
from .studio._views import (
    EXCLUDED,
    GAP,
    USED,
    Series,
    as_bytes,
    clock_of,
    of_loops,
    over_time,
)


class Explorer:
    """A record with linked plots over time and of its loops, in a notebook; it does not change the record.

    - `record`: what is shown. `widget`: the widget, of anywidget.
    - `rows` (n,): the rows that were chosen by dragging over a plot.
    """

    def __init__(self, record: Record):
        self.record: Record = record
        self._series = _series(record)
        self._input, self._output = axes_of(record)
        self.widget: Any = _widget(self._chosen_in_words)
        self.widget.on_msg(lambda _, asked, __: self._answer(asked))

    @property
    def rows(self) -> Bool[np.ndarray, " samples"]:
        """The chosen rows (n,), none of them before one was chosen."""
        return self._rows(self.widget.chosen)

    @property
    def kept(self) -> Record:
        """The record without the chosen rows: they drive a model, and do not count."""
        return self.record.exclude(self.rows)

    @property
    def split(self) -> tuple[Record, Record]:
        """`(train, test)`: the chosen rows are held out."""
        return self.record.split_rows(self.rows)

    def choose(self, low: float | None, high: float | None, box: Any = None) -> None:
        """Choose rows as dragging does: between two times, and in a box of the loops.

        **Arguments:**

        - `low`, `high`: on the axis of the time plot; None is its end.
        - `box`: least and greatest input, least and greatest output.

        **Example:**

            >>> explorer = hysid.explore(record)
            >>> explorer.choose(None, None, box=(-np.inf, np.inf, -np.inf, np.inf))
            >>> bool(explorer.rows.all())
            True
        """
        self.widget.chosen = [low, high, None if box is None else [float(x) for x in box]]

    def _rows(self, chosen: Any) -> np.ndarray:
        return self._series.chosen(*chosen) if chosen else np.zeros(len(self.record), bool)

    def _chosen_in_words(self, chosen: Any) -> str:
        if not (count := int(self._rows(chosen).sum())):
            return "Drag over a plot to choose rows; scroll to zoom."
        return f"{count:,} of {len(self.record):,} rows chosen."

    def _answer(self, asked: Any) -> None:
        """Send the rows that a view shows."""
        low, high = asked.get("view") or (None, None)
        box = asked.get("box")
        time = over_time(self._series, low, high)
        loops, joined = of_loops(self._series, low, high, box)
        clock = f"{self.record.time_name} ({self.record.time_unit})"
        clocked = self.record.time is not None and self._series.x is self.record.time
        names = {"x": clock if clocked else "row", "u": self._input, "y": self._output}
        about = {"shapes": [time.shape[1], loops.shape[1]], "joined": joined, "names": names}
        self.widget.send(about, [as_bytes(time, loops)])

    def _repr_mimebundle_(self, **named: Any) -> Any:
        return self.widget._repr_mimebundle_(**named)


def explore(record: Record) -> Explorer:
    """Linked plots of a record in a notebook: input and output over time, and the loops of what is seen.

    Dragging over a plot chooses rows, scrolling zooms. A million rows are drawn as quickly as a hundred.
    Needs the extra `hysid[notebook]`.

    **Arguments:** `record`: the measurements.

    **Returns:** an `Explorer`, which the notebook shows: `.rows` are the chosen rows, `.kept` is the record
    without them, `.split` holds them out.

    **Raises:** `InputError` `missing-extra` without anywidget.

    **Example:**

        >>> explorer = hysid.explore(record)
        >>> explorer.choose(480.0, 600.0)
        >>> train, test = explorer.split
        >>> int(train.mask.sum()), int(test.mask.sum())
        (80, 21)
    """
    return Explorer(record)


def _series(record: Record) -> Series:
    state = np.where(record.mask, USED, EXCLUDED)
    state[record.starts[1:]] += GAP
    return Series(clock_of(record), record.input, record.output, record.line, state)


def _widget(in_words: Any) -> Any:
    """The widget: its script is that of the studio's plots, in one module."""
    check_extra("notebook", "anywidget")
    # Late: both are of an extra.
    import anywidget
    import traitlets

    class RecordWidget(anywidget.AnyWidget):
        """`chosen`: low, high and box, or nothing; `said`: what is chosen, in words."""

        _esm = script("explorer.js")
        _css = styles()
        chosen = traitlets.List().tag(sync=True)
        said = traitlets.Unicode(in_words([])).tag(sync=True)

        @traitlets.observe("chosen")
        def _tell(self, change: Any) -> None:
            self.said = in_words(change["new"])

    return RecordWidget()
