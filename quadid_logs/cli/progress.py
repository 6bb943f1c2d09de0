"""Say on stderr what takes long, and how long it may still take; stay silent where nothing does."""

from __future__ import annotations

import math
import sys
import threading
import time
from collections.abc import Mapping, Sequence
from itertools import accumulate
from pathlib import Path
from types import MappingProxyType, TracebackType
from typing import TYPE_CHECKING, Final, NamedTuple

from quadid_logs.cli.terminal import is_terminal
from quadid_logs.untrusted import printable

if TYPE_CHECKING:
    from rich.progress import Progress as Bar

_PATIENCE_S = 1.0
#: Fraction of an analysis that is done when a stage begins: the median of twelve logs that hold a flight.
_DONE_BEFORE: Final[Mapping[str, float]] = MappingProxyType(
    {"read": 0.0, "align": 0.02, "identify": 0.06, "writing the report": 0.3}
)


class Part(NamedTuple):
    """Where a log lies in a longer work: the fractions done before and after it, and when that work began."""

    before: float = 0.0
    after: float = 1.0
    started_s: float | None = None


def parts(logs: Sequence[Path]) -> list[Part]:
    """Return the part of each log in the work on all of them, by their sizes."""
    sizes = [float(log.stat().st_size) if log.is_file() else 0.0 for log in logs]
    ends = list(accumulate(sizes))
    whole = ends[-1] if ends and ends[-1] > 0.0 else 1.0
    started_s = time.monotonic()
    return [Part((end - size) / whole, end / whole, started_s) for size, end in zip(sizes, ends, strict=True)]


class Progress:
    """Tell the present stage once a second has passed; a context manager, called with a stage's name.

    On a terminal a bar with the time left is drawn and wiped in the end; in a
    pipe every stage is a line of its own.
    """

    def __init__(self, label: str, *, quiet: bool = False, part: Part | None = None) -> None:
        self._label = printable(label, 60)
        self._started = time.monotonic()
        self._part = part or Part()
        self._stage = ""
        self._quiet = quiet
        self._bar: Bar | None = None
        self._lock = threading.Lock()
        self._timer = threading.Timer(_PATIENCE_S, self._show)
        self._timer.daemon = True

    def __enter__(self) -> Progress:
        if not self._quiet:
            self._timer.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._timer.cancel()
        with self._lock:
            if self._bar is not None:
                self._bar.stop()
            self._quiet = True

    def __call__(self, stage: str) -> None:
        """Note that a stage begins."""
        self._stage = printable(stage, 60)
        if time.monotonic() - self._started > _PATIENCE_S:
            self._show()

    def _show(self) -> None:
        """Show the present stage."""
        with self._lock:
            if self._quiet or not self._stage:
                return
            if is_terminal(sys.stderr):
                if self._bar is None:
                    self._bar = _new_bar()
                    self._bar.add_task(self._label, total=1.0, stage=self._stage, ends_s=None)
                    self._bar.start()
                known = _DONE_BEFORE.get(self._stage)
                done = (
                    0.0
                    if known is None
                    else self._part.before + known * (self._part.after - self._part.before)
                )
                # A stage that is in no list, as of a simulation, tells nothing about the end.
                now = time.monotonic()
                began = self._started if self._part.started_s is None else self._part.started_s
                ends_s = now + (now - began) * (1.0 - done) / done if done > 0.0 else None
                task = self._bar.task_ids[0]
                self._bar.update(
                    task,
                    completed=done,
                    total=None if known is None else 1.0,
                    stage=self._stage,
                    ends_s=ends_s,
                )
            else:
                spent_s = time.monotonic() - self._started
                sys.stderr.write(f"{self._label}: {self._stage} ({spent_s:.0f} s)\n")
                sys.stderr.flush()


def _new_bar() -> Bar:
    """Return a bar on stderr with stage, time spent and time left; rich is imported only for it."""
    from rich.console import Console
    from rich.progress import BarColumn, ProgressColumn, Task, TextColumn, TimeElapsedColumn
    from rich.progress import Progress as RichProgress
    from rich.text import Text

    class TimeLeft(ProgressColumn):
        """Counts down to the end that was last expected."""

        def render(self, task: Task) -> Text:
            ends_s = task.fields["ends_s"]
            return Text("" if ends_s is None else time_left(ends_s - time.monotonic()))

    return RichProgress(
        TextColumn("{task.description}: {task.fields[stage]}", markup=False),
        BarColumn(bar_width=24),
        TimeElapsedColumn(),
        TimeLeft(),
        console=Console(stderr=True),
        transient=True,
    )


def time_left(left_s: float) -> str:
    """Return the time left in words, no finer than it is known.

    Examples
    --------
    >>> time_left(0.4), time_left(17.2), time_left(400.0)
    ('nearly done', 'about 17 s left', 'about 7 min left')
    """
    if left_s < 1.0:
        return "nearly done"
    return f"about {span_words(left_s)} left"


def span_words(span_s: float) -> str:
    """Return a span of time in words, in the unit that fits.

    Examples
    --------
    >>> span_words(45.2), span_words(4000.0), span_words(200_000.0)
    ('45 s', '67 min', '56 h')
    """
    if not math.isfinite(span_s):
        return "unknown time"
    if span_s < 100.0:
        return f"{span_s:.0f} s"
    return f"{span_s / 60.0:.0f} min" if span_s < 7200.0 else f"{span_s / 3600.0:.0f} h"
