"""A whole run: every log a row, wherever the workers are and whatever happens to them.

Of what kills processes, and of what waits for a real clock to run out, two stand for all in a quick run;
what the pool makes of other endings is in `tests/fleet/test_worker.py`.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from urllib.parse import unquote

import psutil
import pytest
from distributed import Client

from benchmarks.fleet_cluster import LoopbackCluster, s3_server
from benchmarks.fleet_rows import n_logs_of, rows_of
from quadid_logs.cli import main
from quadid_logs.errors import OutputError, SettingsError
from quadid_logs.fleets.engine import Cluster
from quadid_logs.fleets.log_files import find_logs
from quadid_logs.fleets.options import Options
from quadid_logs.fleets.run import KNOWN, run_fleet

pytestmark = pytest.mark.filterwarnings("ignore::ResourceWarning")  # sockets of the cluster's own libraries


@pytest.fixture(scope="session")
def undisturbed(logs, tmp_path_factory):
    """The store of a run in which nothing happened."""
    store = tmp_path_factory.mktemp("run") / "store"
    run_fleet(find_logs([str(logs)]), store, Options(), Cluster(workers=1))
    return store


MARGINS = ("gain_margin_db", "phase_margin_deg", "disk_margin")


@pytest.fixture
def few(logs):
    """Of the logs those of one vehicle, and what is no log: enough where it matters who does the work."""
    return sorted(path for path in logs.glob("*.bin") if not path.name.endswith("001.bin"))


@pytest.fixture
def no_log(logs):
    """What becomes a row at once: enough where nothing of an analysis matters."""
    return logs / "noise.bin"


def rows_about(paths, store):
    """Return the rows of these logs."""
    names = {path.name for path in paths}
    return [row for row in rows_of(store) if unquote(row["url"].rsplit("/", 1)[-1]) in names]


#: Started in the background of a script, a process inherits that Ctrl-C is ignored; a terminal's is not.
_COMMAND = """
import signal
signal.signal(signal.SIGINT, signal.default_int_handler)
from quadid_logs.cli import run
run()
"""


def first_on_path(folder):
    """Return the environment in which Python looks into the folder first."""
    return {"PYTHONPATH": os.pathsep.join(filter(None, (str(folder), os.environ.get("PYTHONPATH"))))}


def command(*arguments, environment=None, **keywords):
    return subprocess.Popen(
        [sys.executable, "-c", _COMMAND, *map(str, arguments)],
        env={**os.environ, **(environment or {})},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        **keywords,
    )


def wait_for_logs(store, n_wanted, process=None):
    """Wait until the store holds so many; it can be read while the run goes on."""
    until = time.monotonic() + 120.0
    while n_logs_of(store) < n_wanted:
        assert time.monotonic() < until, "the run got stuck"
        assert process is None or process.poll() is None, process.communicate()
        time.sleep(0.05)


def wait_for_a_download(folder, process):
    """Wait until a log is at work: between two of them there is none."""
    while not list(folder.glob("quadid-fleet-*")):
        assert process.poll() is None, process.communicate()
        time.sleep(0.001)


def test_every_log_is_a_row_per_axis_or_a_reason(undisturbed):
    """Four flights give twelve rows; what is no log gives one with its reason."""
    rows = rows_of(undisturbed)
    flown = [row for row in rows if row["status"] == "analyzed"]
    assert len(flown) == 12
    assert {row["vehicle"] for row in flown} == {
        "CubeOrange 003A0027 3130510A 34383700",
        "CubeOrange 003A0027 3130510A 34383701",
    }
    assert all(row["gain_low"] < row["gain"] < row["gain_high"] for row in flown if row["gain"])
    failed = {row["url"].rsplit("/", 1)[-1]: row["error"] for row in rows if row["status"] == "unreadable"}
    assert sorted(failed) == ["cut.bin", "noise.bin"]
    assert all(failed.values())


def test_resuming_does_nothing_twice(undisturbed, logs):
    """All contents are known, also under a new name."""
    before = rows_of(undisturbed, with_times=True)
    tally = run_fleet(find_logs([str(logs)]), undisturbed, Options(), Cluster(workers=1), resume=True)
    assert tally.counts == {KNOWN: 6}
    assert rows_of(undisturbed, with_times=True) == before


def test_a_store_is_neither_overwritten_nor_mixed(undisturbed, logs, tmp_path):
    """Without --resume, with other options, and into a folder of something else: refused."""
    files = find_logs([str(logs)])
    with pytest.raises(OutputError, match="--resume"):
        run_fleet(files, undisturbed, Options(), Cluster(workers=1))
    with pytest.raises(SettingsError, match="structure"):
        run_fleet(files, undisturbed, Options(structure="linear-9"), Cluster(workers=1), resume=True)
    (tmp_path / "letter.txt").write_text("mine")
    with pytest.raises(OutputError, match="not a fleet store"):
        run_fleet(files, tmp_path, Options(), Cluster(workers=1), resume=True)


@pytest.mark.thorough
def test_a_killed_worker_and_a_restarted_scheduler_change_nothing(undisturbed, logs, tmp_path):
    """Both happen while logs are in flight; the store ends the same."""
    store = tmp_path / "store"
    with LoopbackCluster(tmp_path / "cluster", n_workers=1) as cluster:
        process = command("fleet", logs, "-o", store, "--scheduler", cluster.address)
        try:
            wait_for_logs(store, 1, process)
            cluster.kill_worker()
            wait_for_logs(store, 2, process)
            cluster.restart()
            out, err = process.communicate(timeout=180)
        finally:
            process.kill()
    assert process.returncode == 0, err
    assert "6 logs: 4 analyzed, 2 unreadable" in out
    assert "Traceback" not in err
    assert rows_of(store) == rows_of(undisturbed)


@pytest.mark.thorough
def test_ctrl_c_leaves_a_good_store_that_resume_completes(undisturbed, logs, tmp_path):
    """Interrupted like at a terminal: the whole process group gets the signal."""
    store = tmp_path / "store"
    process = command("fleet", logs, "-o", store, "--workers", "1", start_new_session=True)
    wait_for_logs(store, 1, process)
    os.killpg(process.pid, signal.SIGINT)
    _, err = process.communicate(timeout=180)
    assert process.returncode == 130
    assert "Traceback" not in err
    interrupted = rows_of(store)
    assert all(row in rows_of(undisturbed) for row in interrupted)
    tally = run_fleet(find_logs([str(logs)]), store, Options(), Cluster(workers=1), resume=True)
    assert tally.counts[KNOWN] >= 1
    assert rows_of(store) == rows_of(undisturbed)


def test_a_killed_run_leaves_a_good_store_and_no_process(undisturbed, logs, tmp_path):
    """SIGKILL: no farewell at all; the processes that analyze end by themselves, and clean up."""
    store, downloads = tmp_path / "store", tmp_path / "downloads"
    downloads.mkdir()
    environment = {"TMPDIR": str(downloads)}
    process = command("fleet", logs, "-o", store, "--workers", "1", environment=environment)
    wait_for_logs(store, 1, process)
    processes = psutil.Process(process.pid).children(recursive=True)
    assert processes
    wait_for_a_download(downloads, process)
    process.kill()
    process.communicate(timeout=180)
    assert psutil.wait_procs(processes, timeout=10.0)[1] == []
    assert not list(downloads.glob("quadid-fleet-*"))
    assert all(row in rows_of(undisturbed) for row in rows_of(store))


@pytest.mark.thorough
def test_logs_come_from_an_object_store(undisturbed, logs, tmp_path, monkeypatch):
    """The workers fetch them themselves; the numbers are those of the local files."""
    store = tmp_path / "store"
    with s3_server(logs, "flights") as environment:
        process = command(
            "fleet", "s3://flights", "-o", store, "--workers", "1", "--reports", environment=environment
        )
        _, err = process.communicate(timeout=240)
    assert process.returncode == 0, err
    # A page shows the whole loop, whose margins stand in the rows then.
    of_pages = [f"{each}{end}" for each in MARGINS for end in ("", "_low", "_high")]
    where = ("url", "started_from", *of_pages)
    assert rows_of(store, without=where) == rows_of(undisturbed, without=where)
    assert any(row["gain_margin_db"] for row in rows_of(store))
    assert all(row["url"].startswith("s3://flights/") for row in rows_of(store))
    pages = list((store / "reports").glob("*.html"))
    assert len(pages) == 4
    assert all("s3://flights/" in page.read_text() for page in pages)


#: Python imports this wherever it starts, so in every process that analyzes: some logs are poison.
POISON = """
import os, signal, time
from quadid_logs.fleets import work

whole = work.analyze_flights

def analyze_flights(path, *rest, **named):
    if path.name == "killer.bin":
        os.kill(os.getpid(), signal.SIGKILL)
    if path.name == "reaper.bin":
        os.kill(os.getppid(), signal.SIGKILL)
    if path.name == "holder.bin":
        import ctypes
        ctypes.PyDLL(None).sleep(3600)  # a library that hangs and never lets go of Python's lock
    if path.name == "glutton.bin":
        hoard = bytearray(1 << 30)
        time.sleep(3600.0)
    return whole(path, *rest, **named)

work.analyze_flights = analyze_flights
"""


@pytest.fixture
def poisoned(tmp_path):
    """Give a function that writes a poisoned log, and the environment in which it is poison."""
    (tmp_path / "sitecustomize.py").write_text(POISON)

    def poison(name):
        path = tmp_path / f"{name}.bin"
        path.write_bytes(name.encode())
        return path

    return poison, first_on_path(tmp_path)


#: What a log may take here [minutes]: it takes a second, and on a busy machine a few.
LIMIT_MIN = "0.25"


def lost_rows(store):
    """Return the reasons by the name of the file, and the rows of all other logs."""
    rows = rows_of(store)
    lost = {row["url"].rsplit("/", 1)[-1]: row["error"] for row in rows if row["status"] == "lost"}
    return lost, [row for row in rows if row["status"] != "lost"]


@pytest.mark.thorough
def test_a_log_that_hangs_or_kills_is_a_row_and_its_neighbours_are_not(undisturbed, few, poisoned, tmp_path):
    """Also where a library hangs that holds Python's lock; the next run tries again."""
    store = tmp_path / "store"
    poison, environment = poisoned
    places = [poison("holder"), *few, poison("killer")]
    limits = ("--workers", "2", "--timeout", LIMIT_MIN)
    process = command("fleet", *places, "-o", store, *limits, environment=environment)
    out, err = process.communicate(timeout=240)
    assert process.returncode == 1, err
    assert "2 analyzed, 2 unreadable, 2 lost" in out
    lost, others = lost_rows(store)
    assert lost.keys() == {"holder.bin", "killer.bin"}
    assert "0.25 minutes" in lost["holder.bin"]
    assert "SIGKILL" in lost["killer.bin"]
    assert others == rows_about(few, undisturbed)
    again = run_fleet(find_logs([str(tmp_path)]), store, Options(), Cluster(workers=1), resume=True)
    assert again.counts == {"unreadable": 2}
    assert lost_rows(store)[0] == {}


@pytest.mark.thorough
def test_on_a_cluster_too_no_log_holds_or_fells_a_worker(undisturbed, few, poisoned, tmp_path):
    """Hanging, killing, hoarding: three rows, and the worker is the one that began."""
    store = tmp_path / "store"
    poison, environment = poisoned
    places = [*few, poison("holder"), poison("killer"), poison("glutton")]
    memory = ("--memory-limit", "1GB")
    with LoopbackCluster(tmp_path / "cluster", 1, environment=environment, options=memory) as cluster:
        (worker,) = cluster.workers
        limits = ("--scheduler", cluster.address, "--timeout", LIMIT_MIN)
        process = command("fleet", *places, "-o", store, *limits)
        out, err = process.communicate(timeout=240)
        assert worker.poll() is None
    assert process.returncode == 1, err
    assert "2 analyzed, 2 unreadable, 3 lost" in out
    lost, others = lost_rows(store)
    assert "0.25 minutes" in lost["holder.bin"]
    assert "SIGKILL" in lost["killer.bin"]
    assert "0.95 GB of memory" in lost["glutton.bin"]
    assert others == rows_about(few, undisturbed)


@pytest.mark.thorough
def test_a_log_that_kills_worker_after_worker_is_a_row(undisturbed, few, poisoned, tmp_path):
    """As where a container that takes too much memory is killed as a whole, and started again."""
    store = tmp_path / "store"
    poison, environment = poisoned
    reaper = poison("reaper")
    environment |= {"DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "0"}
    with LoopbackCluster(tmp_path / "cluster", 1, environment=environment) as cluster:
        process = command("fleet", *few, reaper, "-o", store, "--scheduler", cluster.address)
        while process.poll() is None:
            if cluster.workers[0].poll() is not None:
                cluster.kill_worker()
            time.sleep(0.1)
        out, err = process.communicate()
    assert process.returncode == 1, err
    assert "2 analyzed, 2 unreadable, 1 lost" in out
    lost, others = lost_rows(store)
    assert lost.keys() == {"reaper.bin"}
    assert "workers died" in lost["reaper.bin"]
    assert others == rows_about(few, undisturbed)


def test_a_scheduler_that_is_not_there_is_one_clear_line(logs, tmp_path, capsys, monkeypatch):
    """No traceback, exit code 2."""
    monkeypatch.setattr("quadid_logs.fleets.engine._ANSWERS_WITHIN_S", 0.5)
    code = main(["fleet", str(logs), "-o", str(tmp_path / "store"), "--scheduler", "tcp://127.0.0.1:9"])
    assert code == 2
    assert "does not answer" in capsys.readouterr().err


@pytest.mark.parametrize("limit", ["0", "-1", "nan", "inf"])
def test_no_time_at_all_and_no_end_at_all_are_refused(logs, tmp_path, capsys, limit):
    """Before anything is started."""
    assert main(["fleet", str(logs), "-o", str(tmp_path / "store"), "--timeout", limit]) == 2
    assert "--timeout" in capsys.readouterr().err
    assert not (tmp_path / "store").exists()


@pytest.mark.thorough
def test_a_worker_with_another_version_stops_the_run(no_log, tmp_path, monkeypatch):
    """Its numbers would not fit the others."""
    monkeypatch.setattr("quadid_logs.fleets.run.Task", _old_task)
    with pytest.raises(SettingsError, match=r"same version"):
        run_fleet(find_logs([str(no_log)]), tmp_path / "store", Options(), Cluster(workers=1))


def _old_task(**keywords):
    from quadid_logs.fleets.tasks import Task

    return Task(**keywords, version="0.0.1")


@pytest.mark.thorough
@pytest.mark.parametrize("n_workers", [0, 1], ids=["scheduler", "worker"])
def test_a_cluster_without_the_package_stops_the_run(one_log, tmp_path, n_workers):
    """Only a scheduler that lacks it, or a worker too: one clear line, and not a lost row per log."""
    package = tmp_path / "quadid_logs"
    package.mkdir()
    (package / "__init__.py").write_text("raise ImportError('not installed here')")
    environment = {"PYTHONPATH": str(tmp_path), "PYTHONSAFEPATH": "1"}
    with LoopbackCluster(tmp_path / "cluster", n_workers, environment=environment) as cluster:
        with Client(cluster.address, set_as_default=False) as client:
            while len(client.nthreads()) < n_workers:
                time.sleep(0.1)
        process = command("fleet", one_log, "-o", tmp_path / "store", "--scheduler", cluster.address)
        _, err = process.communicate(timeout=120)
    assert process.returncode == 2, err
    assert "cannot load quadid-logs" in err
    assert "Traceback" not in err


@pytest.mark.thorough
def test_a_failure_of_the_worker_is_a_row(one_log, tmp_path):
    """A full disk there, say: no end to the run, no endless loop, and the next run tries again."""
    (tmp_path / "sitecustomize.py").write_text(FULL)
    store = tmp_path / "store"
    environment = first_on_path(tmp_path)
    process = command("fleet", one_log, "-o", store, "--workers", "1", environment=environment)
    out, err = process.communicate(timeout=180)
    assert process.returncode == 1, err
    assert "1 lost" in out
    assert "No space left" in rows_of(store)[0]["error"]


#: Imported wherever Python starts: the disk is full.
FULL = """
from quadid_logs.fleets import work

def fetched(file, max_bytes):
    raise OSError(28, "No space left on device")

work.fetched = fetched
"""


def test_without_a_scheduler_nothing_can_be_reached_from_outside(no_log, tmp_path):
    """Whoever reaches Dask's ports can run code."""
    listening = set()

    def look(_tally):
        found = psutil.Process().net_connections()
        listening.update(one.laddr.ip for one in found if one.status == psutil.CONN_LISTEN)

    run_fleet(find_logs([str(no_log)]), tmp_path / "store", Options(), Cluster(workers=1), progress=look)
    assert listening == {"127.0.0.1"}


def test_threads_of_the_library_end_with_the_run(undisturbed):
    """Nothing of the cluster is left behind in a program that goes on."""
    names = [thread.name for thread in threading.enumerate()]
    assert not [name for name in names if "Nanny" in name or "AsyncProcess" in name]
