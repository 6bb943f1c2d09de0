"""What goes to a worker and what comes back; all of it can be pickled."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from quadid_logs.fleets.log_files import LogFile
from quadid_logs.fleets.options import Options
from quadid_logs.fleets.rows import failure_row
from quadid_logs.version import __version__


@dataclass(frozen=True, slots=True, kw_only=True)
class Task:
    """One log to analyze, unless its content is one of `known` (SHA-256)."""

    file: LogFile
    options: Options
    known: tuple[str, ...] = ()
    version: str = __version__


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """What became of a log.

    ``rows`` are by flight and axis, none where the content was known;
    ``reports`` are pages by number of the flight, compressed with gzip.
    """

    file: LogFile
    sha256: str
    rows: Sequence[Mapping[str, Any]] = ()
    reports: Mapping[int, bytes] = field(default_factory=dict)

    @property
    def status(self) -> str:
        """What became of it, "" where nothing was done."""
        return str(self.rows[0]["status"]) if self.rows else ""

    @property
    def is_known(self) -> bool:
        """Whether nothing was done, because the store has this content."""
        return not self.rows


def failure(task: Task, sha256: str, status: str, error: str) -> Outcome:
    """Return the outcome of a log that gave nothing.

    Parameters
    ----------
    sha256 : str
        Of its content, "" if that was never seen.
    status : str
        `UNREADABLE` or `LOST`.
    """
    row = failure_row(task.file, sha256, task.options.rules, status=status, error=error)
    return Outcome(file=task.file, sha256=sha256, rows=(row,))
