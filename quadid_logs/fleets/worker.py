"""What runs inside a Dask worker: a pool of processes, each for one log at a time.

A log can hang its analysis, fill the memory or crash a library. The process
that it does this to holds nothing else: the pool ends it, the log becomes a
row, and the next log gets a new process.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import tempfile
import threading
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Final, cast

from distributed import Worker, WorkerPlugin, get_worker
from pebble import ProcessExpired, ProcessPool

from quadid_logs.fleets.rows import LOST
from quadid_logs.fleets.tasks import Outcome, Task, failure
from quadid_logs.fleets.work import begin, work_in
from quadid_logs.output import DOWNLOADS, beside_prefix, remove_unfinished
from quadid_logs.version import __version__

_NAME: Final = f"quadid-logs-{__version__}"
_ENVIRONMENT: Final = {
    # One log, one core: there is a process for every other core.
    **dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"),
    # A Dask worker tells the C library to give every freed array back to the system at once; zeroing
    # the pages of the next log's took 14 % of the processor time. These are glibc's own upper limits.
    "MALLOC_MMAP_THRESHOLD_": str(32 << 20),
    "MALLOC_TRIM_THRESHOLD_": str(64 << 20),
}


class ProcessDiedError(Exception):
    """The process ended in the middle of a log, and nobody asked it to."""


class AnalysisPool(WorkerPlugin):
    """The processes of one worker, one per thread."""

    name = _NAME
    #: Runs on one cluster use the same processes.
    idempotent = True

    def setup(self, worker: Worker) -> None:
        """Share the worker's memory among its threads; Dask stops a worker at 95 % of it, too."""
        remove_unfinished(Path(tempfile.gettempdir()), DOWNLOADS)
        limit, self._n_processes = worker.memory_manager.memory_limit, worker.state.nthreads
        self._most_bytes = int(0.95 * limit / self._n_processes) if limit else 0
        self._lock = threading.Lock()
        self._pool = self._new_pool()
        self._before = {name: os.environ.get(name) for name in _ENVIRONMENT}
        os.environ.update(_ENVIRONMENT)  # new processes inherit it

    def teardown(self, worker: Worker) -> None:  # noqa: ARG002 - Dask gives it
        """End all processes."""
        self._pool.stop()  # type: ignore[no-untyped-call]
        self._pool.join()
        for name, value in self._before.items():
            os.environ.pop(name)
            if value is not None:
                os.environ[name] = value

    def analyze(self, task: Task) -> Outcome:
        """Let a process analyze the log; its download goes, whatever becomes of it.

        Raises
        ------
        ProcessDiedError
            If the process ended by itself.
        SettingsError
            If it has another version of quadid-logs.
        """
        with tempfile.TemporaryDirectory(
            prefix=beside_prefix(DOWNLOADS), ignore_cleanup_errors=True
        ) as folder:
            # The pool, a new one where it broke: a process that was idle died
            with self._lock:
                if not self._pool.active:
                    self._pool = self._new_pool()
                running_pool = self._pool
            future = running_pool.schedule(work_in, args=(folder, task), timeout=task.options.timeout_s)
            try:
                return future.result()
            except TimeoutError:
                limit = f"{task.options.timeout_s / 60.0:g} minutes (--timeout)"
                return failure(task, "", LOST, f"It was not analyzed within {limit}.")
            except ProcessExpired as error:
                # Say how a process ended.
                raise ProcessDiedError(
                    signal.Signals(-error.exitcode).name
                    if error.exitcode < 0
                    else f"exit code {error.exitcode}"
                ) from error
            except BrokenProcessPool as error:
                raise ProcessDiedError("the pool broke") from error

    def _new_pool(self) -> ProcessPool:
        return ProcessPool(
            max_workers=self._n_processes,
            initializer=begin,
            initargs=(self._most_bytes,),
            context=multiprocessing.get_context("spawn"),  # threads and forks do not go together
        )


def hand_over(task: Task) -> Outcome:
    """Let one of the worker's processes do a task: what the engine submits to Dask."""
    return cast(AnalysisPool, get_worker().plugins[_NAME]).analyze(task)
