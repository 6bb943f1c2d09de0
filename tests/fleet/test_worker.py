"""The pool of processes inside a Dask worker."""

from __future__ import annotations

import os
import time
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from types import SimpleNamespace

import psutil
import pytest
from pebble import ProcessExpired

from quadid_logs.fleets.log_files import LogFile
from quadid_logs.fleets.options import Options
from quadid_logs.fleets.rows import LOST, UNREADABLE, result_rows
from quadid_logs.fleets.tasks import Task
from quadid_logs.fleets.worker import AnalysisPool, ProcessDiedError
from quadid_logs.pipeline import judge
from tests.tuned_flights import flown

#: What Dask gives a plugin, as far as it is used here: one thread, no limit of memory.
WORKER = SimpleNamespace(memory_manager=SimpleNamespace(memory_limit=None), state=SimpleNamespace(nthreads=1))


@pytest.fixture
def pool(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "3")
    pool = AnalysisPool()
    pool.setup(WORKER)
    yield pool
    pool.teardown(WORKER)
    assert os.environ["OMP_NUM_THREADS"] == "3"


@pytest.fixture
def task(tmp_path):
    """A file that is no log: it becomes a row at once."""
    path = tmp_path / "noise.bin"
    path.write_bytes(b"no log at all" * 100)
    return Task(file=LogFile(url=str(path)), options=Options())


@pytest.mark.thorough
def test_a_process_killed_between_two_logs_costs_no_log(pool, task):
    """As the kernel does it where another program takes the memory."""
    before = set(psutil.Process().children())
    assert pool.analyze(task).status == UNREADABLE
    begun = set(psutil.Process().children()) - before
    (process,) = (one for one in begun if "spawn_main" in " ".join(one.cmdline()))
    process.kill()
    until = time.monotonic() + 60.0
    while pool._pool.active and time.monotonic() < until:
        time.sleep(0.05)
    assert not pool._pool.active
    assert pool.analyze(task).status == UNREADABLE


def test_nothing_is_left_of_a_download(pool, task, tmp_path, monkeypatch):
    """The folder for it goes with the log."""
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    pool.analyze(task)
    assert [path.name for path in tmp_path.iterdir()] == ["noise.bin"]


@pytest.fixture
def end_with(pool, monkeypatch):
    """Let each log end at once in an error, as the clock and the kernel do it in earnest elsewhere."""

    def end(error):
        future = Future()
        future.set_exception(error)
        monkeypatch.setattr(pool._pool, "schedule", lambda *_arguments, **_keywords: future)

    return end


def test_a_log_that_takes_too_long_is_a_row_that_names_the_limit(pool, task, end_with):
    """So that it can be given more time."""
    end_with(TimeoutError())
    outcome = pool.analyze(replace(task, options=Options(timeout_s=15.0)))
    assert outcome.status == LOST
    assert "0.25 minutes (--timeout)" in outcome.rows[0]["error"]


@pytest.mark.parametrize(("code", "words"), [(-9, "SIGKILL"), (-11, "SIGSEGV"), (3, "exit code 3")])
def test_a_process_that_ended_by_itself_is_told_by_how(pool, task, end_with, code, words):
    """Killed by the kernel, or by a library."""
    end_with(ProcessExpired("", code=code))
    with pytest.raises(ProcessDiedError, match=words):
        pool.analyze(task)


def test_a_pool_that_broke_under_a_log_is_told_too(pool, task, end_with):
    """The log is tried again elsewhere."""
    end_with(BrokenProcessPool())
    with pytest.raises(ProcessDiedError, match="the pool broke"):
        pool.analyze(task)


@pytest.mark.thorough
def test_a_fleets_rows_are_the_same_but_for_margins_with_what_verdicts_rest_on_alone():
    """No margin of a loop has a part in anything else."""
    whole = flown("ardupilot")
    short = judge(
        whole.log, whole.data, whole.settings, vehicle=None, timings_s={"total": 0.0}, loop="verdict"
    )
    rows = [result_rows((each,), LogFile(url="a.bin"), "", Options().rules) for each in (whole, short)]
    other = ("run_s", "gain_margin_db", "phase_margin_deg", "disk_margin")
    with_margins, without = (
        [{name: value for name, value in row.items() if not name.startswith(other)} for row in each]
        for each in rows
    )
    assert with_margins == without
    assert not any("gain_margin_db" in row for row in rows[1])
    assert short.closed_loop.axes["roll"].margins is None
