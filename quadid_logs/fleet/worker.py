"""What runs inside a Dask worker: it hands each log to a process and waits for the answer."""

from __future__ import annotations

import threading
from typing import cast

from distributed import Worker, WorkerPlugin, get_worker

from quadid_logs.fleet.analyst import Analyst
from quadid_logs.fleet.tasks import Outcome, Task
from quadid_logs.version import __version__

_NAME = f"quadid-logs-{__version__}"


class Analysts(WorkerPlugin):
    """The processes of one worker, one per thread, started when they are needed."""

    name = _NAME
    #: Runs that share a cluster share the processes.
    idempotent = True

    def setup(self, worker: Worker) -> None:
        """Share the worker's memory among its threads; Dask stops a worker at 95 % of it, too."""
        limit = worker.memory_manager.memory_limit
        self._most_bytes = int(0.95 * limit / worker.state.nthreads) if limit else None
        self._lock = threading.Lock()
        self._idle: list[Analyst] = []
        self._busy: list[Analyst] = []
        self._ended = False

    def teardown(self, worker: Worker) -> None:  # noqa: ARG002 - Dask gives it
        """End all processes; who waits for one will stop it."""
        with self._lock:
            self._ended = True
            for analyst in self._busy:
                analyst.kill()
            while self._idle:
                self._idle.pop().stop()

    def analyze(self, task: Task) -> Outcome:
        """Let a process analyze the log."""
        analyst = self._borrow()
        try:
            return analyst.analyze(task)
        finally:
            self._give_back(analyst)

    def _borrow(self) -> Analyst:
        """Return a process that nobody uses."""
        with self._lock:
            analyst = self._idle.pop() if self._idle else Analyst(self._most_bytes)
            self._busy.append(analyst)
        return analyst

    def _give_back(self, analyst: Analyst) -> None:
        """Keep the process for the next log, if it histories."""
        with self._lock:
            self._busy.remove(analyst)
            keep = analyst.is_alive and not self._ended
            if keep:
                self._idle.append(analyst)
        if not keep:
            analyst.stop()


def hand_over(task: Task) -> Outcome:
    """Let one of the worker's processes do a task: what the engine submits to Dask."""
    return cast(Analysts, get_worker().plugins[_NAME]).analyze(task)
