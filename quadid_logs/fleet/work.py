"""What a worker does with one log. Everything that comes in and goes out can be pickled."""

from __future__ import annotations

import dataclasses
import gzip
from collections.abc import Mapping
from dataclasses import dataclass, field

from quadid_logs.data.result import Result
from quadid_logs.errors import QuadidError, SettingsError
from quadid_logs.fleet.flights import analyze_flights
from quadid_logs.fleet.options import Options
from quadid_logs.fleet.rows import LOST, UNREADABLE, failure_row, parquet_bytes, result_rows
from quadid_logs.fleet.sources import FetchError, Source, fetched
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


def work(task: Task) -> Outcome:
    """Fetch, read and analyze one log; whatever is wrong with it becomes its row.

    Raises
    ------
    SettingsError
        If this worker has another version of quadid-logs: its numbers would not fit the others.
    """
    if task.version != __version__:
        raise SettingsError(
            f"A worker has quadid-logs {__version__}, but {task.version} is needed.",
            hint="Install the same version everywhere.",
        )
    try:
        with fetched(task.source, task.options.max_bytes) as (path, sha256):
            if sha256 in task.known:
                return Outcome(source=task.source, sha256=sha256)
            try:
                results = tuple(analyze_flights(path, task.options.settings, task.options.vehicle))
            except QuadidError as error:
                return failure(task, sha256, UNREADABLE, str(error).replace(str(path), "The file"))
            except Exception as error:  # noqa: BLE001 - one log must never stop the others
                return failure(
                    task,
                    sha256,
                    UNREADABLE,
                    f"unexpected {type(error).__name__}: {error}; a bug in quadid-logs",
                )
            return _success(task, sha256, results)
    except FetchError as error:
        return failure(task, "", LOST, str(error))


def failure(task: Task, sha256: str, status: str, error: str) -> Outcome:
    """Return the outcome of a log that gave nothing."""
    row = failure_row(task.source, sha256, task.options.rules, status=status, error=error)
    return Outcome(
        source=task.source, sha256=sha256, status=status, vehicle=row["vehicle"], table=parquet_bytes([row])
    )


def _success(task: Task, sha256: str, results: tuple[Result, ...]) -> Outcome:
    """Return the outcome of an analyzed log."""
    rows = result_rows(results, task.source, sha256, task.options.rules)
    return Outcome(
        source=task.source,
        sha256=sha256,
        status=rows[0]["status"],
        vehicle=rows[0]["vehicle"],
        table=parquet_bytes(rows),
        reports={flight: _page(result, task.source, sha256) for flight, result in enumerate(results)}
        if task.options.reports
        else {},
    )


def _page(result: Result, source: Source, sha256: str) -> bytes:
    """Return the compressed report of one flight; it names the log, not the copy that was read."""
    from quadid_logs.figures import figures_of
    from quadid_logs.report.html import render_html
    from quadid_logs.report.provenance import Provenance
    from quadid_logs.report.view import view_of

    named = dataclasses.replace(result, log=dataclasses.replace(result.log, path=source.url))
    provenance = Provenance(version=__version__, command="", log_sha256=sha256)
    page = render_html(view_of(named, provenance), figures_of(named))
    return gzip.compress(page.encode())
