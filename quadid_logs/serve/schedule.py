"""The queue: one job per core at a time, in the order in which they came, whatever becomes of the others."""

from __future__ import annotations

import contextlib
import shutil
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

from quadid_logs.errors import QuadidError
from quadid_logs.serve.entries import Entry, State
from quadid_logs.serve.estimate import Pace, Progress
from quadid_logs.serve.jobs import Done, Job
from quadid_logs.serve.store import ServeStore
from quadid_logs.serve.worker import JobError, Worker
from quadid_logs.untrusted import printable

#: Between two tries to write to a disk that is full [s].
_DISK_PAUSE_S: Final = 5.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """Of the jobs: how many at a time, and what each may take (0 bytes: all memory)."""

    n_workers: int
    timeout_s: float
    most_bytes: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Changes:
    """What a page has to learn: entries that changed since a version, ids that are gone, running jobs."""

    version: int
    entries: tuple[Entry, ...]
    gone: tuple[str, ...]
    running: Mapping[str, Mapping[str, Any]]
    n_waiting: int
    left_s: float


@dataclass(slots=True, eq=False)
class _Running:
    """A job that is being done; ``worker`` is None until one has it."""

    progress: Progress
    worker: Worker | None = None

    def kill(self) -> None:
        """End its process."""
        if self.worker is not None:
            self.worker.kill()


class Schedule:
    """Entries, and the threads that let workers do them; any thread may call it."""

    def __init__(self, store: ServeStore, limits: Limits) -> None:
        """Take up what the store holds; `start` begins the work."""
        self._store = store
        self._limits = limits
        self._entries = store.entries()
        self._changed: dict[str, int] = dict.fromkeys(self._entries, 0)
        self._gone: dict[str, int] = {}
        self._version = 0
        self._running: dict[str, _Running] = {}
        self._pace = Pace()
        self._condition = threading.Condition(threading.RLock())
        self._closing = False
        self._threads: list[threading.Thread] = []
        self._spare: list[Worker] = []
        self.listeners: set[Callable[[], None]] = set()

    def start(self) -> None:
        """Begin the work; one process is started at once, so that the first log need not wait for it."""
        self._spare.append(Worker(self._limits.most_bytes))
        for number in range(self._limits.n_workers):
            thread = threading.Thread(target=self._work, name=f"slot-{number}", daemon=True)
            thread.start()
            self._threads.append(thread)

    def stop(self) -> None:
        """End the work; what is running goes back into the queue."""
        with self._condition:
            self._closing = True
            for key, running in self._running.items():
                running.kill()
                entry = self._entries[key]
                with contextlib.suppress(QuadidError):
                    self._put(replace(entry, state=State.QUEUED, summary={}, n_begun=entry.n_begun - 1))
            self._condition.notify_all()
        for thread in self._threads:
            thread.join(15.0)
        for worker in self._spare:
            worker.kill()

    @property
    def is_idle(self) -> bool:
        """Whether nothing runs or waits."""
        with self._condition:
            return all(entry.is_final for entry in self._entries.values())

    def get(self, entry_id: str) -> Entry | None:
        """Return an entry, None where there is none."""
        with self._condition:
            return self._entries.get(entry_id)

    def entries(self) -> tuple[Entry, ...]:
        """Return all entries in the order in which they came."""
        with self._condition:
            return tuple(self._entries.values())

    def submit(self, entry: Entry) -> Entry:
        """Add an entry; one that is there already stays as it is, unless it gave nothing.

        That which is there.
        """
        with self._condition:
            held = self._entries.get(entry.id)
            if held is not None and held.state not in (State.FAILED, State.CANCELLED):
                return held
            self._put(entry)
            return entry

    def again(self, entry_id: str) -> None:
        """Do once more what is final."""
        with self._condition:
            entry = self._entries.get(entry_id)
            if entry is not None and entry.is_final:
                self._put(replace(entry, state=State.QUEUED, error="", summary={}, n_begun=0))

    def choose(self, entry_id: str, number: int) -> bool:
        """Analyze another log of a file that holds several; what was asked about the first one is deleted.

        Whether the file holds such a log.
        """
        with self._condition:
            entry = self._entries.get(entry_id)
            if entry is None or not entry.is_final or str(number) not in entry.summary.get("lengths_s", {}):
                return False
            for other in [each.id for each in self._entries.values() if entry_id in each.logs]:
                if other != entry_id:
                    self._forget_one(other)
            options = {**entry.options, "log": number, "lengths_s": entry.summary["lengths_s"]}
            again = replace(entry, options=options, state=State.QUEUED, error="", summary={}, n_begun=0)
            self._put(again)
            return True

    def cancel(self, entry_id: str) -> None:
        """Let a job be: its process is killed."""
        with self._condition:
            entry = self._entries.get(entry_id)
            if entry is None or entry.is_final:
                return
            # Under the lock: a moment later the process may have another job.
            running = self._running.pop(entry_id, None)
            if running is not None:
                running.kill()
            self._put(replace(entry, state=State.CANCELLED, summary={}))

    def rename(self, entry_id: str, name: str) -> None:
        """Call the vehicle that flew a log otherwise, in all its logs."""
        with self._condition:
            entry = self._entries.get(entry_id)
            vehicle = entry.summary.get("vehicle") if entry is not None else None
            if not isinstance(vehicle, str) or vehicle == name:
                return
            self._store.rename(vehicle, name)
            for each in [one for one in self._entries.values() if one.summary.get("vehicle") == vehicle]:
                self._put(replace(each, summary={**each.summary, "vehicle": name}))

    def forget(self, entry_id: str) -> None:
        """Delete an entry and everything about it; of a log also what was asked about it."""
        with self._condition:
            for other in [each.id for each in self._entries.values() if entry_id in each.logs]:
                if other != entry_id:
                    self._forget_one(other)
            self._forget_one(entry_id)

    def changes(self, since: int) -> Changes:
        """Return what changed after a version; 0 gives everything."""
        now_s = time.monotonic()
        with self._condition:
            fresh = [entry for key, entry in self._entries.items() if not since or self._changed[key] > since]
            waiting = [entry for entry in self._entries.values() if entry.state is State.QUEUED]
            running: dict[str, dict[str, Any]] = {
                key: {
                    "stage": each.progress.stage,
                    "fraction": round(each.progress.fraction(now_s), 3),
                    "left_s": round(each.progress.left_s(now_s), 1),
                }
                for key, each in self._running.items()
            }
            left_s = sum(float(each["left_s"]) for each in running.values())
            left_s += sum(self._pace.expected_s(entry.n_bytes, entry.kind) for entry in waiting)
            return Changes(
                version=max(self._version, 1),
                entries=tuple(fresh),
                gone=tuple(key for key, version in self._gone.items() if version > since) if since else (),
                running=running,
                n_waiting=len(waiting),
                left_s=left_s / self._limits.n_workers,
            )

    def _forget_one(self, entry_id: str) -> None:
        entry = self._entries.get(entry_id)
        if entry is None:
            return
        self.cancel(entry_id)
        del self._entries[entry_id], self._changed[entry_id]
        self._store.forget(entry)
        self._version = max(self._version, 1) + 1
        self._gone[entry_id] = self._version
        self._notify()

    def _put(self, entry: Entry) -> None:
        """Write an entry, and tell who listens."""
        self._store.put(entry)
        self._note(entry)

    def _note(self, entry: Entry) -> None:
        self._version = max(self._version, 1) + 1
        self._entries[entry.id] = entry
        self._changed[entry.id] = self._version
        self._gone.pop(entry.id, None)
        self._condition.notify_all()
        self._notify()

    def _notify(self) -> None:
        for listener in list(self.listeners):
            listener()

    def _work(self) -> None:
        """Do one job after the other: what a thread does."""
        worker: Worker | None = None
        while not self._closing:
            try:
                found = self._next()
            except QuadidError:  # a full disk: the queue waits until there is room
                time.sleep(_DISK_PAUSE_S)
                continue
            if found is not None:
                if worker is None or not worker.is_alive:
                    # The process that was started ahead, or a new one.
                    with self._condition:
                        spare = self._spare.pop() if self._spare else None
                    worker = (
                        spare if spare is not None and spare.is_alive else Worker(self._limits.most_bytes)
                    )
                self._do(*found, worker)
        if worker is not None:
            worker.kill()

    def _next(self) -> tuple[Entry, _Running] | None:
        """Wait for a job and mark it as running; None when the server ends."""
        with self._condition:
            while not self._closing:
                found = next((e for e in self._entries.values() if e.state is State.QUEUED), None)
                if found is not None:
                    begun = replace(found, state=State.RUNNING, n_begun=found.n_begun + 1)
                    self._put(begun)
                    expected_s = self._pace.expected_s(begun.n_bytes, begun.kind)
                    running = _Running(Progress(began_s=time.monotonic(), expected_s=expected_s))
                    self._running[begun.id] = running
                    return begun, running
                self._condition.wait()
        return None

    def _do(self, entry: Entry, running: _Running, worker: Worker) -> None:
        """Let a worker do a job, and keep what came of it."""
        with self._condition:
            if self._is_over(entry, running):
                return
            running.worker = worker
        folder: Path | None = None
        try:
            folder = self._store.new_work()

            def tell(stage: str, summary: Mapping[str, Any] | None) -> None:
                """Note each stage of a job, and its verdict as soon as that is known."""
                with self._condition:
                    running.progress.begin_stage(stage, time.monotonic())
                    if summary is not None and not self._is_over(entry, running):
                        self._note(replace(entry, summary=self._store.named(Done(summary=summary)).summary))
                    self._notify()

            known = [self.get(log) for log in entry.logs]
            job = Job(
                kind=entry.kind,
                logs=tuple(str(self._store.log(log)) for log in entry.logs),
                names=tuple(
                    log if one is None else one.name for log, one in zip(entry.logs, known, strict=True)
                ),
                numbers=tuple(0 if one is None else int(one.options.get("log", 0)) for one in known),
                sha256=entry.logs,
                n_bytes=entry.n_bytes,
                options=entry.options,
                folder=str(folder),
            )
            done = worker.do(job, tell, self._limits.timeout_s)
            with self._condition:
                done = self._store.named(done)
                if not self._is_over(entry, running):
                    finished = replace(entry, state=State.DONE, summary=done.summary, n_begun=0)
                    self._store.keep(finished, folder, done.outcome)
                    self._end(finished)
            self._pace.learn(entry.n_bytes, time.monotonic() - running.progress.began_s, entry.kind)
        except JobError as error:
            self._fail(entry, running, str(error))
        except QuadidError as error:
            self._fail(entry, running, f"The result could not be kept: {error}")
        finally:
            if folder is not None:
                shutil.rmtree(folder, ignore_errors=True)

    def _is_over(self, entry: Entry, running: _Running) -> bool:
        """Return whether somebody cancelled or deleted it meanwhile, or the server ends."""
        return self._closing or self._running.get(entry.id) is not running

    def _end(self, entry: Entry) -> None:
        """Note an entry that is done with."""
        del self._running[entry.id]
        self._note(entry)

    def _fail(self, entry: Entry, running: _Running, reason: str) -> None:
        with self._condition:
            if not self._is_over(entry, running):
                failed = replace(entry, state=State.FAILED, error=printable(reason, 600))
                with contextlib.suppress(QuadidError):  # on a full disk it is known until the server ends
                    self._store.put(failed)
                self._end(failed)
