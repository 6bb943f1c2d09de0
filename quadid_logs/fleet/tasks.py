"""What goes to a worker and what comes back; all of it can be pickled."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from quadid_logs.fleet.options import Options
from quadid_logs.fleet.rows import failure_row, parquet_bytes
from quadid_logs.fleet.sources import Source
from quadid_logs.version import __version__


@dataclass(frozen=True, slots=True, kw_only=True)
class Task:
    """One log to analyze, unless its content is one of `known` (SHA-256)."""

    source: Source
    options: Options
    known: tuple[str, ...] = ()
    version: str = __version__


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """What became of a log.

    ``table`` is a Parquet file of its rows, empty where the content was known;
    ``reports`` are pages by number of the flight, compressed with gzip.
    """

    source: Source
    sha256: str
    status: str = ""
    vehicle: str = ""
    table: bytes = b""
    reports: Mapping[int, bytes] = field(default_factory=dict)

    @property
    def is_known(self) -> bool:
        """Whether nothing was done, because the store has this content."""
        return not self.table


def failure(task: Task, sha256: str, status: str, error: str) -> Outcome:
    """Return the outcome of a log that gave nothing."""
    row = failure_row(task.source, sha256, task.options.rules, status=status, error=error)
    return Outcome(
        source=task.source, sha256=sha256, status=status, vehicle=row["vehicle"], table=parquet_bytes([row])
    )
