"""The queue and the store: each log one result, whatever is cancelled, deleted, killed or begun again."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from quadid_logs.errors import OutputError, SettingsError
from quadid_logs.fleets.log_files import LogFile
from quadid_logs.fleets.options import Options
from quadid_logs.fleets.rows import failure_row
from quadid_logs.fleets.tasks import Outcome
from quadid_logs.serve import schedule as schedule_module
from quadid_logs.serve.entries import Entry, Kind, State, log_entry, question
from quadid_logs.serve.jobs import Done, Job
from quadid_logs.serve.schedule import Limits, Schedule
from quadid_logs.serve.store import ServeStore
from quadid_logs.serve.worker import JobError

LIMITS = Limits(n_workers=2, timeout_s=5.0, most_bytes=0)


class FakeWorker:
    """Does jobs in the thread that asks for them, each when `gate` is open, until it is killed."""

    gate = threading.Event()
    running: list[str] = []  # noqa: RUF012 - of the test
    most_at_once = 0

    def __init__(self, most_bytes: int) -> None:  # noqa: ARG002 - as of a Worker
        self.is_alive = True

    def do(self, job: Job, told: Callable[[str, Any], None], timeout_s: float) -> Done:  # noqa: ARG002
        """Write a result and what a history is to hold."""
        FakeWorker.running.append(job.names[0])
        FakeWorker.most_at_once = max(FakeWorker.most_at_once, len(FakeWorker.running))
        try:
            told("read", None)
            while not self.gate.wait(0.01):
                if not self.is_alive:
                    raise JobError("Its process ended (SIGKILL).")
            if job.names[0].startswith("bad"):
                raise JobError("no flight log")
            (Path(job.folder) / "report.html").write_text(f"report of {job.names[0]}")
            file = LogFile(url=job.names[0], n_bytes=job.n_bytes)
            row = failure_row(file, job.sha256[0], Options().rules, status="unreadable", error="SECRETROW")
            return Done(
                summary={"headline": "fine", "log": job.numbers[0], "lengths_s": {"1": 8.0, "2": 9.0}},
                outcome=Outcome(file=file, sha256=job.sha256[0], rows=(row,)),
            )
        finally:
            FakeWorker.running.remove(job.names[0])

    def kill(self) -> None:
        """End it."""
        self.is_alive = False


@pytest.fixture(autouse=True)
def fake_worker(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """No processes here: they are tested with the whole server."""
    monkeypatch.setattr(schedule_module, "Worker", FakeWorker)
    monkeypatch.setattr(FakeWorker, "gate", threading.Event())
    monkeypatch.setattr(FakeWorker, "running", [])
    monkeypatch.setattr(FakeWorker, "most_at_once", 0)
    yield
    FakeWorker.gate.set()


@contextmanager
def working(folder: Path) -> Iterator[Schedule]:
    """Give a queue that works on a store."""
    with ServeStore(folder) as store:
        schedule = Schedule(store, LIMITS)
        schedule.start()
        try:
            yield schedule
        finally:
            schedule.stop()


def sha(number: int) -> str:
    """Return an id."""
    return f"{number:064x}"


def add(schedule: Schedule, number: int, name: str = "") -> Entry:
    """Upload a log and queue it."""
    schedule._store.log(sha(number)).write_bytes(b"log")
    return schedule.submit(log_entry(sha(number), name or f"{number}.bin", 3, -1.0))


def wait(schedule: Schedule, states: dict[int, State]) -> None:
    """Wait until entries are in these states."""
    until = time.monotonic() + 20.0
    while time.monotonic() < until:
        held = {number: schedule.get(sha(number)) for number in states}
        if all(entry is not None and entry.state is states[number] for number, entry in held.items()):
            return
        time.sleep(0.01)
    raise AssertionError([(entry.name, entry.state) for entry in schedule.entries()])


def wait_for_workers(n_workers: int) -> None:
    """Wait until so many workers have a job: an entry is running a moment before a worker has it."""
    until = time.monotonic() + 20.0
    while len(FakeWorker.running) < n_workers:
        assert time.monotonic() < until, FakeWorker.running
        time.sleep(0.01)


def test_there_are_never_more_jobs_than_workers(tmp_path: Path) -> None:
    """And all get done."""
    with working(tmp_path / "s") as schedule:
        for number in range(8):
            add(schedule, number)
        wait(schedule, {0: State.RUNNING, 1: State.RUNNING, 2: State.QUEUED})
        wait_for_workers(2)
        FakeWorker.gate.set()
        wait(schedule, dict.fromkeys(range(8), State.DONE))
    assert FakeWorker.most_at_once == 2


def test_a_log_that_is_dropped_twice_is_done_once(tmp_path: Path) -> None:
    """By its content, under the name that came first."""
    with working(tmp_path / "s") as schedule:
        first = add(schedule, 1, "first.bin")
        assert add(schedule, 1, "second.bin").name == first.name
        assert len(schedule.entries()) == 1


def test_another_log_of_the_file_takes_the_place_of_the_first(tmp_path: Path) -> None:
    FakeWorker.gate.set()
    with working(tmp_path / "s") as schedule:
        add(schedule, 1)
        wait(schedule, {1: State.DONE})
        assert schedule.choose(sha(1), 2)
        wait(schedule, {1: State.DONE})
        (entry,) = schedule.entries()
        assert entry.summary["log"] == 2


def test_gains_of_another_log_of_the_file_are_not_kept(tmp_path: Path) -> None:
    FakeWorker.gate.set()
    with working(tmp_path / "s") as schedule:
        add(schedule, 1)
        wait(schedule, {1: State.DONE})
        asked = schedule.submit(question(Kind.TUNE, "next gains", (sha(1),)))
        schedule.choose(sha(1), 2)
        assert schedule.get(asked.id) is None


@pytest.mark.parametrize("number", [0, 3])
def test_a_log_that_the_file_does_not_hold_cannot_be_chosen(tmp_path: Path, number: int) -> None:
    FakeWorker.gate.set()
    with working(tmp_path / "s") as schedule:
        add(schedule, 1)
        wait(schedule, {1: State.DONE})
        assert not schedule.choose(sha(1), number)


def test_what_cannot_be_done_says_why_and_stops_nothing(tmp_path: Path) -> None:
    """One bad log of many."""
    FakeWorker.gate.set()
    with working(tmp_path / "s") as schedule:
        add(schedule, 1, "bad.bin")
        add(schedule, 2)
        wait(schedule, {1: State.FAILED, 2: State.DONE})
        assert "no flight log" in schedule.get(sha(1)).error


def test_a_cancelled_job_makes_room_for_the_next(tmp_path: Path) -> None:
    """Its process is killed; the others go on."""
    with working(tmp_path / "s") as schedule:
        for number in range(3):
            add(schedule, number)
        wait(schedule, {0: State.RUNNING, 1: State.RUNNING})
        schedule.cancel(sha(0))
        wait(schedule, {0: State.CANCELLED, 2: State.RUNNING})
        FakeWorker.gate.set()
        wait(schedule, {0: State.CANCELLED, 1: State.DONE, 2: State.DONE})


def test_a_cancelled_job_can_be_done_again(tmp_path: Path) -> None:
    """What its first process still says no longer counts."""
    with working(tmp_path / "s") as schedule:
        add(schedule, 1)
        wait(schedule, {1: State.RUNNING})
        schedule.cancel(sha(1))
        schedule.again(sha(1))
        FakeWorker.gate.set()
        wait(schedule, {1: State.DONE})


def test_deleting_leaves_nothing_of_a_log_on_the_disk(tmp_path: Path) -> None:
    """Not its copy, its results, its comparisons, nor a trace in the databases."""
    FakeWorker.gate.set()
    with working(tmp_path / "s") as schedule:
        for number in (1, 2):
            add(schedule, number, f"SECRETNAME{number}")
        wait(schedule, {1: State.DONE, 2: State.DONE})
        compared = schedule.submit(question(Kind.COMPARE, "SECRETNAME1 and 2", (sha(1), sha(2))))
        schedule.forget(sha(1))
        assert schedule.get(compared.id) is None
        assert schedule.get(sha(2)).state is State.DONE
        schedule.forget(sha(2))
    left = b"".join(path.read_bytes() for path in (tmp_path / "s").rglob("*") if path.is_file())
    assert b"SECRET" not in left
    assert sha(1).encode() not in left
    assert not list((tmp_path / "s").rglob(f"*{sha(1)}*"))


def test_a_deleted_job_that_runs_is_ended(tmp_path: Path) -> None:
    """And leaves no result."""
    with working(tmp_path / "s") as schedule:
        add(schedule, 1)
        wait(schedule, {1: State.RUNNING})
        schedule.forget(sha(1))
        FakeWorker.gate.set()
        add(schedule, 2)
        wait(schedule, {2: State.DONE})
        assert [entry.id for entry in schedule.entries()] == [sha(2)]
        assert [path.name for path in (tmp_path / "s" / "results").iterdir()] == [sha(2)]


def test_the_queue_survives_the_end_of_the_server(tmp_path: Path) -> None:
    """What ran and what waited is done by the next one."""
    with working(tmp_path / "s") as schedule:
        for number in range(4):
            add(schedule, number)
        wait(schedule, {0: State.RUNNING, 1: State.RUNNING})
    FakeWorker.gate.set()
    with working(tmp_path / "s") as schedule:
        wait(schedule, dict.fromkeys(range(4), State.DONE))


def test_what_a_killed_server_left_is_taken_up_or_deleted(tmp_path: Path) -> None:
    """Half an upload, half a result, a result that the table does not know, a log without an entry."""
    with ServeStore(tmp_path / "s") as store:
        store.log(sha(1)).write_bytes(b"log")
        store.put(replace(log_entry(sha(1), "a.bin", 3, -1.0), state=State.RUNNING, n_begun=1))
        store.result(sha(1)).mkdir()
        (store.new_work() / "report.html").write_text("half")
        store.new_upload().write_bytes(b"half")
        store.log(sha(2)).write_bytes(b"nobody knows it")
    with ServeStore(tmp_path / "s") as store:
        assert store.entries()[sha(1)].state is State.QUEUED
        left = {path.relative_to(store.folder).as_posix() for path in store.folder.glob("*/*")}
        assert left == {f"logs/{sha(1)}"}


def test_a_log_that_ends_its_server_again_and_again_is_let_be(tmp_path: Path) -> None:
    """Otherwise no log behind it would ever be done."""
    with ServeStore(tmp_path / "s") as store:
        entry = log_entry(sha(1), "a.bin", 3, -1.0)
        store.put(replace(entry, state=State.RUNNING, n_begun=3))
    with ServeStore(tmp_path / "s") as store:
        assert store.entries()[sha(1)].state is State.FAILED


def test_a_second_server_on_the_same_store_is_refused(tmp_path: Path) -> None:
    """And told where the first one is."""
    with (
        ServeStore(tmp_path / "s", "http://127.0.0.1:1"),
        pytest.raises(SettingsError, match=r"127\.0\.0\.1:1"),
    ):
        ServeStore(tmp_path / "s")


def test_a_folder_of_something_else_is_refused(tmp_path: Path) -> None:
    """What the queue does not know is deleted, so it must be ours."""
    (tmp_path / "logs").mkdir()
    (tmp_path / "logs" / "flight.bin").write_bytes(b"dear")
    (tmp_path / "notes.txt").write_text("dear")
    with pytest.raises(OutputError, match="not a store of"):
        ServeStore(tmp_path)
    assert (tmp_path / "logs" / "flight.bin").exists()


def test_a_page_learns_what_changed_since_it_last_heard(tmp_path: Path) -> None:
    """Entries that are new or changed, and those that are gone."""
    with ServeStore(tmp_path / "s") as store:
        schedule = Schedule(store, LIMITS)
        add(schedule, 1)
        heard = schedule.changes(0).version
        add(schedule, 2)
        schedule.forget(sha(1))
        news = schedule.changes(heard)
        assert [entry.id for entry in news.entries] == [sha(2)]
        assert news.gone == (sha(1),)
