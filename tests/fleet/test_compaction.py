"""One file per vehicle instead of one per log: at every moment the same rows."""

from __future__ import annotations

import itertools
import shutil
from pathlib import Path

import pytest

from benchmarks.fleet_rows import rows_of
from quadid_logs.errors import SettingsError
from quadid_logs.fleet import compaction
from quadid_logs.fleet import files as store_files
from quadid_logs.fleet.compaction import compact
from quadid_logs.fleet.engine import Cluster
from quadid_logs.fleet.files import TOGETHER, dataset, own_files, partition, rows_by_vehicle
from quadid_logs.fleet.identity import NamingRules
from quadid_logs.fleet.options import Options
from quadid_logs.fleet.rows import LOST, UNREADABLE
from quadid_logs.fleet.run import run_fleet
from quadid_logs.fleet.sources import Source, find_sources
from quadid_logs.fleet.sql import ask
from quadid_logs.fleet.store import Store
from quadid_logs.fleet.tasks import Outcome, Task, failure

VEHICLES = ("a", "b")
OPTIONS = Options(rules=NamingRules(vehicle_from="/([ab])/"))


def outcome(number, *, vehicle="a", status=UNREADABLE, error="no log"):
    """One log's row; its folder names the vehicle."""
    task = Task(source=Source(url=f"/{vehicle}/{number}.bin", n_bytes=100 + number), options=OPTIONS)
    return failure(task, "" if status == LOST else f"{number:064x}", status, error)


@pytest.fixture
def store(tmp_path, monkeypatch):
    """Four logs of each of two vehicles, one lost; every vehicle is worth a file."""
    monkeypatch.setattr(compaction, "_WORTH", 1)
    store = Store(tmp_path / "store", OPTIONS, resume=False)
    for number in range(8):
        store.take(outcome(number, vehicle=VEHICLES[number % 2]))
    store.take(outcome(9, status=LOST))
    return store


def files(folder):
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*.parquet"))


def by_vehicle(folder):
    return sorted(
        (row["vehicle"], row["url"]) for rows in rows_by_vehicle(folder, ["vehicle", "url"]) for row in rows
    )


def test_there_is_a_file_per_vehicle_and_the_same_rows(store):
    """But for the lost log, which the next run replaces."""
    before, lives = rows_of(store.folder), by_vehicle(store.folder)
    compact(store.folder)
    together = [path for path in files(store.folder) if path.endswith(TOGETHER)]
    assert together == [f"{partition(vehicle)}/{TOGETHER}" for vehicle in VEHICLES]
    assert len(files(store.folder)) == 3
    assert rows_of(store.folder) == before
    assert by_vehicle(store.folder) == lives


@pytest.mark.parametrize("read", [dataset, by_vehicle])
def test_a_store_that_is_put_together_while_it_is_read_is_a_clear_error(read, store, monkeypatch):
    """Files are listed, and gone when they are opened."""

    def listed_and_gone(folder):
        found = own_files(folder)
        monkeypatch.undo()
        monkeypatch.setattr(compaction, "_WORTH", 1)
        compact(folder)
        return found

    monkeypatch.setattr(store_files, "own_files", listed_and_gone)
    with pytest.raises(SettingsError, match="changed while it was read"):
        read(store.folder)


def test_a_few_files_are_left_alone(store, monkeypatch):
    """A day with one log more does not write the whole life again."""
    monkeypatch.setattr(compaction, "_WORTH", 5)
    before = files(store.folder)
    compact(store.folder)
    assert files(store.folder) == before


def test_what_is_put_together_is_known(store):
    """Resuming does nothing twice, and tries what was lost again."""
    compact(store.folder)
    again = Store(store.folder, OPTIONS, resume=True)
    assert again.known(Source(url="/moved.bin", n_bytes=103)) == (f"{3:064x}",)
    assert again.known(Source(url="/a/9.bin", n_bytes=109)) == ()
    assert not again.take(Outcome(source=Source(url="/a/0.bin"), sha256=f"{3:064x}"))


@pytest.fixture
def newer(store, monkeypatch):
    """The store put together, and opened by another version, which does everything again."""
    compact(store.folder)
    for module in ("store", "rows", "tasks"):
        monkeypatch.setattr(f"quadid_logs.fleet.{module}.__version__", "9.9.9")
    return Store(store.folder, OPTIONS, resume=True)


def test_a_log_analyzed_again_counts_instead_of_what_was_put_together(store, newer):
    """Another version may even find another vehicle; before and after the next time, each log is one row."""
    newer.take(outcome(0, error="still no log"))
    newer.take(outcome(2, vehicle="b", error="still no log"))
    expected = [(number, "still no log" if number in (0, 2) else "no log") for number in range(8)]
    for _ in range(2):
        rows = [row for row in rows_of(store.folder) if row["status"] != LOST]
        assert [(int(row["sha256"], 16), row["error"]) for row in rows] == expected
        assert ("b", "/b/2.bin") in by_vehicle(store.folder)
        assert len(by_vehicle(store.folder)) == 9
        assert list(ask(store.folder, "SELECT count(*), count(DISTINCT url) FROM fleet").rows) == [(9, 9)]
        compact(store.folder)
    assert len(files(store.folder)) == 3


def test_a_vehicle_that_lost_all_its_logs_to_another_has_no_file(store, newer):
    """No file without rows."""
    for number in range(0, 8, 2):
        newer.take(outcome(number, vehicle="b"))
    compact(store.folder)
    assert not (store.folder / partition("a") / TOGETHER).exists()
    assert {vehicle for vehicle, url in by_vehicle(store.folder) if url != "/a/9.bin"} == {"b"}


def test_a_kill_at_any_moment_changes_no_row(store, newer, tmp_path, monkeypatch):
    """Stopped before each change to the disk, and put together again after it."""
    for number in (0, 1):
        newer.take(outcome(number, vehicle="a"))  # one of them was put together as the other vehicle's
    newer.take(outcome(10, vehicle="b"))
    before = rows_of(store.folder)
    for n_changes in itertools.count():
        folder = shutil.copytree(store.folder, tmp_path / str(n_changes))
        if not _is_killed_before_change(n_changes, folder, monkeypatch):
            break
        assert rows_of(folder) == before
        assert list(ask(folder, "SELECT count(*) FROM fleet").rows) == [(10,)]
        assert Store(folder, OPTIONS, resume=True).known(Source(url="", n_bytes=110)) == (f"{10:064x}",)
        compact(folder)
        assert rows_of(folder) == before
        assert len(files(folder)) == 3
    assert n_changes == 5  # two files written, three removed
    assert rows_of(folder) == before


class Killed(BaseException):
    """Nothing catches it, as nothing catches SIGKILL."""


def _is_killed_before_change(number, folder, monkeypatch):
    """Compact, but stop before this change; return whether it came that far."""
    left = [number]

    def counted(change):
        def instead(path, *arguments, **keywords):
            if path.suffix == ".parquet" or arguments:
                if not left[0]:
                    raise Killed
                left[0] -= 1
            return change(path, *arguments, **keywords)

        return instead

    with monkeypatch.context() as patch:
        patch.setattr(Path, "replace", counted(Path.replace))
        patch.setattr(Path, "unlink", counted(Path.unlink))
        try:
            compact(folder)
        except Killed:
            return True
    return False


def test_a_run_ends_with_a_store_put_together(logs, tmp_path, monkeypatch):
    """And the next one finds everything known."""
    monkeypatch.setattr(compaction, "_WORTH", 1)
    folder = tmp_path / "store"
    run_fleet(find_sources([str(logs)]), folder, Options(), Cluster(workers=1))
    assert {Path(path).name for path in files(folder)} == {TOGETHER}
    tally = run_fleet(find_sources([str(logs)]), folder, Options(), Cluster(workers=1), resume=True)
    assert tally.counts == {"known": 6}
