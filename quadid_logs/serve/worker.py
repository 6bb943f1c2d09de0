"""A process that does one job at a time, with limits of time and memory; it can be killed at any moment.

What a log can do to a library it does to this process: the server ends it,
the log becomes a line that says why, and the next one gets a new process.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import tempfile
import time
from collections.abc import Callable, Mapping
from multiprocessing.connection import Connection
from typing import Any, Final

from quadid_logs.errors import QuadidError
from quadid_logs.serve.jobs import Done, Job, Tell, do
from quadid_logs.untrusted import printable

#: How often a running job's deadline is looked at [s].
_LOOK_S: Final = 1.0
#: A killed process is gone after this [s], unless the system hangs.
_GONE_S: Final = 10.0
#: One log, one core: there is a process for every other core.
_ENVIRONMENT: Final = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")

Told = Callable[[str, Mapping[str, Any] | None], None]


class JobError(Exception):
    """The job gave nothing; the text says why, for people."""


class Worker:
    """A process that was started and waits for jobs, from one thread; any thread may kill it."""

    def __init__(self, most_bytes: int) -> None:
        """Start the process; it loads what it needs by itself.

        Parameters
        ----------
        most_bytes : int
            Memory that it may take, 0 for all.
        """
        context = multiprocessing.get_context("spawn")
        self._connection, theirs = context.Pipe()
        os.environ.update({name: os.environ.get(name, one) for name, one in _ENVIRONMENT.items()})
        self._process = context.Process(target=serve_jobs, args=(theirs, most_bytes), daemon=True)
        self._process.start()
        theirs.close()

    @property
    def is_alive(self) -> bool:
        """Whether it can take another job."""
        return self._process.is_alive()

    def do(self, job: Job, told: Told, timeout_s: float) -> Done:
        """Do a job and wait for it.

        Parameters
        ----------
        told : callable
            Called with each stage as it begins, and with the summary once there is one.
        timeout_s : float
            After which the process is killed.

        Raises
        ------
        JobError
            If it failed, took too long, or its process ended.
        """
        deadline = time.monotonic() + timeout_s
        try:
            self._connection.send(job)
            while True:
                if self._connection.poll(_LOOK_S):
                    answer = self._connection.recv()
                    if isinstance(answer, Done):
                        return answer
                    if isinstance(answer, JobError):
                        raise answer
                    told(*answer)
                elif time.monotonic() > deadline:
                    self.kill()
                    self._process.join(_GONE_S)
                    raise JobError(f"The analysis was not done within {timeout_s / 60.0:g} minutes.")
        except (EOFError, OSError) as error:
            self.kill()
            self._process.join(_GONE_S)
            code = self._process.exitcode
            ending = signal.Signals(-code).name if code is not None and code < 0 else f"exit code {code}"
            raise JobError(f"The process of the analysis ended ({ending}).") from error

    def kill(self) -> None:
        """End the process at once."""
        with contextlib.suppress(OSError, ValueError):
            self._process.kill()


def serve_jobs(connection: Connection, most_bytes: int) -> None:
    """Do jobs until nobody sends any: what runs in the process.

    Parameters
    ----------
    connection : Connection
        Gives jobs, takes stages and what came of them.
    most_bytes : int
        Memory that the process may take, 0 for all.
    """
    from quadid_logs.fleets.work import begin

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C ends the server, and that ends us
    begin(most_bytes)
    # Import what every job needs, while nobody waits for it yet.
    import quadid_logs.fleets.rows
    import quadid_logs.pipeline
    import quadid_logs.report.folder
    import quadid_logs.report.html
    import quadid_logs.report.view  # noqa: F401

    while True:
        try:
            job: Job = connection.recv()
        except (EOFError, OSError):
            return
        tempfile.tempdir = job.folder
        answer = _answer(job, lambda stage, summary: connection.send((stage, summary)))
        connection.send(answer)


def _answer(job: Job, tell: Tell) -> Done | JobError:
    """Do a job; whatever goes wrong is told in words."""
    try:
        return do(job, tell)
    except QuadidError as error:
        return JobError(_told(error, job))
    except MemoryError:
        return JobError("The analysis needs more memory than it may use.")
    except Exception as error:  # noqa: BLE001 - one log must never stop the others
        return JobError(
            printable(f"unexpected {type(error).__name__}: {_told(error, job)}; a bug in quadid-logs")
        )


def _told(error: Exception, job: Job) -> str:
    """Return an error's text with the names that people know in the place of our paths."""
    text = str(error)
    for path, name in zip(job.logs, job.names, strict=True):
        text = text.replace(path, name)
    return printable(text, 600)
