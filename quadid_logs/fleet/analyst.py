"""A process for the analysis alone, beside the worker that answers for it.

A log can hang its analysis, fill the memory or crash a library. The process
that it does this to holds nothing else: it is ended, the log becomes a row, and
the next log gets a new one.
"""

from __future__ import annotations

import contextlib
import faulthandler
import multiprocessing
import os
import queue
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Final

from quadid_logs.errors import QuadidError
from quadid_logs.fleet.extra import load
from quadid_logs.fleet.rows import LOST
from quadid_logs.fleet.tasks import Outcome, Task, failure

_START: Final = "import sys; from quadid_logs.fleet.analyst import serve; serve(*sys.argv[1:])"
#: How often time and memory are looked at [s]: a process can hardly fill a machine meanwhile.
_LOOK_S: Final = 0.5
#: A process whose worker is gone cannot be known to end while a library holds Python's lock; it ends
#: this much [s] after the time limit.
_GRACE_S: Final = 60.0
_ENVIRONMENT: Final = {
    # One log, one core: there is a process for every other core.
    **dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"),
    # A Dask worker tells the C library to give every freed array back to the system at once; zeroing
    # the pages of the next log's took 14 % of the processor time. These are glibc's own upper limits.
    "MALLOC_MMAP_THRESHOLD_": str(32 << 20),
    "MALLOC_TRIM_THRESHOLD_": str(64 << 20),
}


class AnalystDiedError(Exception):
    """The process ended in the middle of a log, and nobody asked it to."""


class Analyst:
    """A process that analyzes one log at a time; it ends with the worker, however that ends."""

    def __init__(self, most_bytes: int | None) -> None:
        """Start it; it may take `most_bytes` of memory."""
        self._most_bytes = most_bytes
        self._folder = tempfile.TemporaryDirectory(prefix="quadid-fleet-", ignore_cleanup_errors=True)
        self._connection, theirs = multiprocessing.Pipe()
        environment = {**os.environ, **_ENVIRONMENT, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
        with theirs:
            self._process = subprocess.Popen(  # noqa: S603 - our own interpreter and code
                [sys.executable, "-c", _START, str(theirs.fileno()), self._folder.name],
                env=environment,
                pass_fds=[theirs.fileno()],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                process_group=0,  # a terminal's Ctrl-C is for the one who asked for the work
            )

    def analyze(self, task: Task) -> Outcome:
        """Do the task, or end the process where that takes too much time or memory.

        Raises
        ------
        AnalystDiedError
            If the process ended by itself.
        SettingsError
            If it has another version of quadid-logs.
        """
        until = time.monotonic() + task.options.timeout_s
        try:
            self._connection.send(task)
            while not self._connection.poll(_LOOK_S):
                reason = self._excess(task, until)
                if reason:
                    self.stop()
                    return failure(task, "", LOST, reason)
            answer: Outcome | QuadidError = self._connection.recv()
        except (EOFError, OSError) as error:
            ending = self._ending()
            self.stop()
            raise AnalystDiedError(ending) from error
        if isinstance(answer, QuadidError):
            raise answer
        return answer

    @property
    def is_alive(self) -> bool:
        """Whether it can take another log."""
        return self._process.poll() is None

    def kill(self) -> None:
        """End the process; whoever waits for it is known."""
        self._process.kill()

    def stop(self) -> None:
        """End the process and remove what it leaves."""
        self._connection.close()
        self.kill()
        with contextlib.suppress(subprocess.TimeoutExpired):  # a system call that hangs outlives even that
            self._process.wait(_LOOK_S)
        self._folder.cleanup()

    def _excess(self, task: Task, until: float) -> str:
        """Say what there is too much of, if anything."""
        if time.monotonic() > until:
            return f"It was not analyzed within {task.options.timeout_s / 60.0:g} minutes (--timeout)."
        if self._most_bytes is not None and self._memory_bytes() > self._most_bytes:
            return f"Its analysis takes more than the {self._most_bytes / 1e9:.2g} GB of memory of a worker."
        return ""

    def _memory_bytes(self) -> int:
        """Return what the process has in memory, 0 if it has just ended."""
        psutil = load("psutil")
        try:
            return int(psutil.Process(self._process.pid).memory_info().rss)
        except psutil.NoSuchProcess:
            return 0

    def _ending(self) -> str:
        """Say how the process ended; its end of the connection is closed just before."""
        try:
            code = self._process.wait(_LOOK_S)
        except subprocess.TimeoutExpired:
            return "it answers no more"
        return signal.Signals(-code).name if code < 0 else f"exit code {code}"


def serve(descriptor: str, folder: str) -> None:
    """Be the process: analyze what comes over the connection until it closes; downloads go to the folder."""
    from quadid_logs.fleet.work import work

    tempfile.tempdir = folder
    connection = Connection(int(descriptor))
    tasks: queue.SimpleQueue[Task] = queue.SimpleQueue()
    threading.Thread(target=_listen, args=(connection, tasks, folder), daemon=True).start()
    with Path(os.devnull).open("w") as nowhere:
        while True:
            task = tasks.get()
            faulthandler.dump_traceback_later(task.options.timeout_s + _GRACE_S, exit=True, file=nowhere)
            answer: Outcome | QuadidError
            try:
                answer = work(task)
            except QuadidError as error:
                answer = error
            faulthandler.cancel_dump_traceback_later()
            connection.send(answer)


def _listen(connection: Connection, tasks: queue.SimpleQueue[Task], folder: str) -> None:
    """Take what comes, and end the process with its worker, also in the middle of a log."""
    try:
        while True:
            tasks.put(connection.recv())
    except (EOFError, OSError):
        shutil.rmtree(folder, ignore_errors=True)
        os._exit(0)
