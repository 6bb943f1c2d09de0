"""Hand the logs out to Dask's workers and take the outcomes as they come.

A worker that dies takes only its logs in flight with it; Dask gives them to
another. A log whose analysis kills its process is tried again alone, when no
neighbour can have taken its memory, and becomes a row. A scheduler that goes
away is waited for; what it held in flight is handed out again.
"""

from __future__ import annotations

import contextlib
import logging
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

from quadid_logs.errors import QuadidError, SettingsError
from quadid_logs.extra import load
from quadid_logs.fleets.rows import LOST
from quadid_logs.fleets.tasks import Outcome, Task, failure
from quadid_logs.untrusted import printable

#: Tasks handed out per thread: one runs, one waits on the worker, the rest bridge the way to the
#: scheduler and back. More would only be lost together.
_AHEAD: Final = 4
#: How long a scheduler may be away [s]: a machine restarts in less.
PATIENCE_S: Final = 300.0
_RECONNECT_S: Final = 1.0
#: Until a scheduler must have answered once [s].
_ANSWERS_WITHIN_S: Final = 10.0
_LOOPBACK: Final = "127.0.0.1:0"
#: Of what Dask does beside the work, a run of hours needs neither samples of where Python is (100 a
#: second) nor fifty looks a second at whether its own loop is busy.
_LEAN: Final = {
    "distributed.worker.profile.enabled": False,
    "distributed.admin.tick.interval": "500ms",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Cluster:
    """Where to work: an existing scheduler's address, or as many local processes."""

    scheduler: str = ""
    workers: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class Events:
    """What the engine reports while it runs.

    ``take`` gets every outcome and returns False if the task must be done
    again although its content is known; ``began`` gets the dashboard's
    address; ``notice`` gets what happened to workers and scheduler.
    """

    take: Callable[[Outcome], bool]
    began: Callable[[str], None]
    notice: Callable[[str], None]


class _SchedulerGoneError(Exception):
    """The scheduler went away; what was in flight must be handed out again."""


def run(tasks: Sequence[Task], cluster: Cluster, events: Events) -> None:
    """Do all tasks and hand every outcome to `events.take`, in the order in which they finish.

    Raises
    ------
    SettingsError
        If the scheduler does not answer, or its workers have not this version of quadid-logs.
    """
    with _local_or_given(cluster) as address:
        dispatcher = _Dispatcher(address, events)
        try:
            dispatcher.work_through(tasks, ahead=_AHEAD)
            dispatcher.work_through(dispatcher.retry_list, ahead=0)
        finally:
            dispatcher.leave()


@contextlib.contextmanager
def _local_or_given(cluster: Cluster) -> Iterator[str]:
    """Give the scheduler's address; a local cluster histories in this process, as long as the run."""
    if cluster.scheduler:
        # Where it goes away, the library shows its own attempts to come back as tracebacks.
        with load("distributed.utils", "fleet").silence_logging_cmgr(logging.CRITICAL):
            yield cluster.scheduler
        return
    with (
        load("dask", "fleet").config.set(_LEAN),
        load("distributed", "fleet").LocalCluster(
            n_workers=1,
            threads_per_worker=cluster.workers or None,
            processes=False,  # the threads only wait: each has a process for the analysis
            dashboard_address=_LOOPBACK,
            worker_dashboard_address=_LOOPBACK,  # it listens on all interfaces otherwise
            silence_logs=logging.CRITICAL,
        ) as local,
    ):
        yield str(local.scheduler_address)


class _Dispatcher:
    """A connection to the scheduler and the tasks in flight on it."""

    def __init__(self, address: str, events: Events) -> None:
        self._address = address
        self._events = events
        self._client = self._connect(SettingsError)
        self._in_flight: dict[str, Task] = {}
        self.retry_list: list[Task] = []
        events.began(str(self._client.dashboard_link))
        if not self._n_threads():
            events.notice("the scheduler has no workers yet; waiting for them")

    def work_through(self, tasks: Sequence[Task], *, ahead: int) -> None:
        """Do tasks, `ahead` per thread at a time, or one alone if that is zero."""
        waiting = deque(tasks)
        while waiting:
            try:
                # Keep the workers busy until nothing waits and nothing is in flight.
                done = load("distributed", "fleet").as_completed(loop=self._client.loop)
                self._hand_out(waiting, done, ahead)
                for future in done:
                    task = self._in_flight[future.key]
                    self._settle(task, future, waiting)
                    del self._in_flight[future.key]
                    self._hand_out(waiting, done, ahead)
            except _SchedulerGoneError:
                # In front, in their old order: the store must not depend on it, but people watch.
                waiting.extendleft(reversed(self._in_flight.values()))
                self._in_flight.clear()
                self._events.notice("the scheduler does not answer; waiting for it")
                self.leave()
                self._client = self._connect(_SchedulerAwayError)
                self._events.notice("the scheduler is back")

    def leave(self) -> None:
        """Close the connection; what is still in flight is given up."""
        with contextlib.suppress(OSError):  # it may be gone already
            self._client.close(timeout=5)

    def _connect(self, failure_type: type[QuadidError]) -> Any:  # the client's library has no types
        """Try until the scheduler answers."""
        distributed = load("distributed", "fleet")
        patience_s = PATIENCE_S if failure_type is _SchedulerAwayError else 0.0
        until = time.monotonic() + patience_s
        while True:
            try:
                client = distributed.Client(self._address, timeout=_ANSWERS_WITHIN_S, set_as_default=False)
                return _equipped(client)
            except QuadidError:
                raise
            except (OSError, ValueError) as error:
                if time.monotonic() >= until:
                    raise failure_type(
                        f"The scheduler {printable(self._address)} does not answer.",
                        hint="Check the address, and continue with --resume.",
                    ) from error
            time.sleep(_RECONNECT_S)

    def _hand_out(self, waiting: deque[Task], done: Any, ahead: int) -> None:
        """Submit tasks up to what may be in flight."""
        from quadid_logs.fleets.worker import hand_over

        if self._client.status != "running":
            raise _SchedulerGoneError
        try:
            most = max(ahead * self._n_threads(), 1)
            while waiting and len(self._in_flight) < most:
                future = self._client.submit(hand_over, waiting[0], pure=False)
                self._in_flight[future.key] = waiting.popleft()
                done.add(future)
        except OSError as error:
            raise _SchedulerGoneError from error

    def _n_threads(self) -> int:
        """Return how many tasks can run at once."""
        return sum(self._client.nthreads().values())

    def _settle(self, task: Task, future: Any, waiting: deque[Task]) -> None:
        """Take an outcome; or tell a killed worker, and what stops the whole run, from a log that fails."""
        from quadid_logs.fleets.worker import ProcessDiedError

        distributed = load("distributed", "fleet")
        try:
            error: BaseException | None = future.exception() if future.status == "error" else None
            outcome: Outcome | None = None if error else future.result()
        except (distributed.CancelledError, OSError) as gone:
            raise _SchedulerGoneError from gone
        if error is None:
            if outcome is not None and not self._events.take(outcome):
                waiting.append(Task(file=task.file, options=task.options))
        elif isinstance(error, ProcessDiedError):
            self._put_on_retry_list(task, f"Analyzing it killed the process ({error})")
        elif isinstance(error, distributed.KilledWorker):
            self._put_on_retry_list(task, "Its workers died")
        elif isinstance(error, QuadidError):
            raise error
        elif isinstance(error, ImportError) or "deserialization" in str(error):  # of what was submitted
            raise _foreign(error) from error
        else:
            reason = f"The worker failed: {type(error).__name__}: {printable(error)}."
            self._events.take(failure(task, "", LOST, reason))

    def _put_on_retry_list(self, task: Task, what: str) -> None:
        """Try a log whose process died again, alone, after the others; after that it is a row."""
        if task in self.retry_list:
            self._events.take(failure(task, "", LOST, f"{what}, repeatedly and when run alone."))
            self._events.notice(f"{printable(task.file.url)} kills the process that analyzes it")
        else:
            self.retry_list.append(task)


def _equipped(client: Any) -> Any:
    """Give the workers, present and to come, their processes for the analysis."""
    from quadid_logs.fleets.worker import AnalysisPool

    try:
        client.register_plugin(AnalysisPool())
    except Exception as error:
        client.close(timeout=5)
        if isinstance(error, OSError):
            raise
        raise _foreign(error) from error  # whatever it was there, here it is a plain Exception
    return client


def _foreign(error: BaseException) -> SettingsError:
    return SettingsError(
        f"The scheduler or a worker cannot load quadid-logs: {printable(error)}.",
        hint="Install the same version of quadid-logs[fleet] there.",
    )


class _SchedulerAwayError(QuadidError):
    """The scheduler did not come back."""
