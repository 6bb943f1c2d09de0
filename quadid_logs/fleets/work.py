"""What is done with one log, in a process for that alone."""

from __future__ import annotations

import dataclasses
import faulthandler
import gzip
import multiprocessing
import os
import shutil
import tempfile
import threading
from pathlib import Path
from typing import Final

from quadid_logs.control.closed_loop import LoopPart
from quadid_logs.data.result import Result
from quadid_logs.errors import QuadidError, SettingsError
from quadid_logs.fleets.log_files import FetchError, LogFile, fetched
from quadid_logs.fleets.per_flight import analyze_flights
from quadid_logs.fleets.rows import LOST, UNREADABLE, result_rows
from quadid_logs.fleets.tasks import Outcome, Task, failure
from quadid_logs.untrusted import printable
from quadid_logs.version import __version__

#: A process whose worker is gone cannot be asked to end while a library holds Python's lock; it ends
#: this much [s] after the time limit.
_GRACE_S: Final = 60.0


def begin(most_bytes: int) -> None:
    """Prepare a process: it may take so much memory (0: all), and ends with its worker, however that ends."""
    if most_bytes:
        import resource

        resource.setrlimit(resource.RLIMIT_DATA, (most_bytes, most_bytes))
    threading.Thread(target=_end_with_worker, daemon=True).start()


def _end_with_worker() -> None:
    """Wait until the worker is gone, and remove what lies in the folder for downloads."""
    worker = multiprocessing.parent_process()
    if worker is not None:
        worker.join()
        if tempfile.tempdir:
            shutil.rmtree(tempfile.tempdir, ignore_errors=True)
        os._exit(0)


def work_in(folder: str, task: Task) -> Outcome:
    """Do `work` in a process that `begin` prepared; downloads go to the folder.

    Raises
    ------
    SettingsError
        As `work` does.
    """
    tempfile.tempdir = folder
    with Path(os.devnull).open("w") as nowhere:
        faulthandler.dump_traceback_later(task.options.timeout_s + _GRACE_S, exit=True, file=nowhere)
        try:
            return work(task)
        finally:
            faulthandler.cancel_dump_traceback_later()
            tempfile.tempdir = None


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
        with fetched(task.file, task.options.max_bytes) as (path, sha256):
            if sha256 in task.known:
                return Outcome(file=task.file, sha256=sha256)
            return _analyze(task, path, sha256)
    except FetchError as error:
        return failure(task, "", LOST, str(error))
    except MemoryError:
        import resource

        limit = resource.getrlimit(resource.RLIMIT_DATA)[0]
        known = limit != resource.RLIM_INFINITY
        more = f"than the {limit / 1e9:.2g} GB of memory of a worker" if known else "memory than a worker has"
        return failure(task, "", LOST, f"Its analysis needs more {more}.")
    except Exception as error:  # noqa: BLE001 - a full disk, say: one log must never stop the others
        return failure(task, "", LOST, f"The worker failed: {type(error).__name__}: {printable(error)}.")


def _analyze(task: Task, path: Path, sha256: str) -> Outcome:
    """Analyze a log; what fails for its content will fail again."""
    try:
        # Rows hold the verdicts alone of the loop without --margins; a page shows all of it.
        loop: LoopPart = "whole" if task.options.reports or task.options.margins else "verdict"
        # Rows hold the recommended model; a page shows all.
        flights = analyze_flights(
            path, task.options.settings, task.options.vehicle, loop, published=task.options.reports
        )
        results = tuple(flights)
    except QuadidError as error:
        return failure(task, sha256, UNREADABLE, str(error).replace(str(path), "The file"))
    except MemoryError:
        raise
    except Exception as error:  # noqa: BLE001 - one log must never stop the others
        reason = f"unexpected {type(error).__name__}: {error}; a bug in quadid-logs"
        return failure(task, sha256, UNREADABLE, reason)
    # The outcome of an analyzed log.
    rows = result_rows(results, task.file, sha256, task.options.rules)
    return Outcome(
        file=task.file,
        sha256=sha256,
        rows=rows,
        reports={flight: _page(result, task.file, sha256) for flight, result in enumerate(results)}
        if task.options.reports
        else {},
    )


def _page(result: Result, file: LogFile, sha256: str) -> bytes:
    """Return the compressed report of one flight; it names the log, not the copy that was read."""
    from quadid_logs.figures import figures_of
    from quadid_logs.report.html import render_html
    from quadid_logs.report.provenance import Provenance
    from quadid_logs.report.view import view_of

    named = dataclasses.replace(result, log=dataclasses.replace(result.log, path=file.url))
    provenance = Provenance(version=__version__, command="", log_sha256=sha256)
    page = render_html(view_of(named, provenance), figures_of(named))
    return gzip.compress(page.encode())
