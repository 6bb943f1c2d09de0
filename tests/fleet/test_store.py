"""The store: whole files only, one per content, and hostile names lead nowhere."""

from __future__ import annotations

import gzip
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.fleet_rows import rows_of
from quadid_logs.errors import OutputError, SettingsError
from quadid_logs.fleet.files import dataset, partition
from quadid_logs.fleet.options import Options
from quadid_logs.fleet.rows import LOST, UNREADABLE
from quadid_logs.fleet.sources import Source
from quadid_logs.fleet.store import Store
from quadid_logs.fleet.tasks import Outcome, Task, failure


def outcome(url, sha256="a" * 64, *, status=UNREADABLE, n_bytes=10):
    task = Task(source=Source(url=url, n_bytes=n_bytes), options=Options())
    return failure(task, "" if status == LOST else sha256, status, "no log")


@pytest.fixture
def store(tmp_path):
    return Store(tmp_path / "store", Options(), resume=False)


def files(store):
    return sorted(path.name for path in store.folder.rglob("*.parquet"))


@given(name=st.text(max_size=300))
def test_every_name_is_one_folder_inside_the_store(name):
    """Path traversal, empty names, control characters, other alphabets, endless names."""
    folder = Path("/store") / partition(name)
    assert folder.parent == Path("/store")
    assert folder.name.isascii()
    assert folder.name.isprintable()
    assert len(folder.name) < 200
    assert ".." not in folder.name


@given(first=st.text(max_size=200), second=st.text(max_size=200))
def test_two_names_are_two_folders(first, second):
    """Escaping loses nothing."""
    assert (partition(first) == partition(second)) == (first == second)


def test_of_two_names_for_one_content_the_first_stays(store):
    """In whatever order the workers finish."""
    for url in ("/b.bin", "/c.bin", "/a.bin"):
        assert store.take(outcome(url))
    assert [row["url"] for row in rows_of(store.folder)] == ["/a.bin"]
    assert len(files(store)) == 1


def test_a_known_content_under_an_earlier_name_is_done_again(store):
    """So that a resumed run ends with the store of an uninterrupted one."""
    store.take(outcome("/b.bin"))
    assert not store.take(Outcome(source=Source(url="/a.bin"), sha256="a" * 64))
    assert store.take(Outcome(source=Source(url="/c.bin"), sha256="a" * 64))


def test_what_was_lost_is_forgotten_when_it_is_found(store):
    """The row of the failure goes."""
    store.take(outcome("/a.bin", status=LOST))
    assert [row["status"] for row in rows_of(store.folder)] == [LOST]
    store.take(outcome("/a.bin"))
    assert [row["status"] for row in rows_of(store.folder)] == [UNREADABLE]


def test_a_lost_log_is_not_known(store):
    """The next run tries again; a log that can never be read is not tried again."""
    store.take(outcome("/a.bin", status=LOST, n_bytes=11))
    store.take(outcome("/b.bin", n_bytes=12))
    again = Store(store.folder, Options(), resume=True)
    assert again.known(Source(url="/a.bin", n_bytes=11)) == ()
    assert again.known(Source(url="/moved.bin", n_bytes=12)) == ("a" * 64,)


def test_another_version_does_the_work_again_and_replaces_its_rows(store, monkeypatch):
    """Numbers of two versions are not mixed."""
    store.take(outcome("/a.bin"))
    for module in ("store", "rows", "work"):
        monkeypatch.setattr(f"quadid_logs.fleet.{module}.__version__", "9.9.9")
    again = Store(store.folder, Options(), resume=True)
    assert again.known(Source(url="/a.bin", n_bytes=10)) == ()
    again.take(outcome("/a.bin"))
    assert [row["version"] for row in rows_of(store.folder)] == ["9.9.9"]


def test_what_a_killed_run_left_half_written_is_removed(store):
    """And never read: its name begins with a dot."""
    store.take(outcome("/a.bin"))
    part = next(store.folder.rglob("*.parquet")).with_name(".half.parquet.123.part")
    part.write_bytes(b"PAR1")
    assert len(rows_of(store.folder)) == 1
    Store(store.folder, Options(), resume=True)
    assert not part.exists()


def test_a_full_disk_is_one_clear_line(store, monkeypatch):
    """And leaves no half file."""
    monkeypatch.setattr("os.fsync", _full)
    with pytest.raises(OutputError, match="No space left"):
        store.take(outcome("/a.bin"))
    assert not [path for path in store.folder.rglob("*") if path.suffix in (".parquet", ".part")]


def _full(_descriptor):
    raise OSError(28, "No space left on device")


def test_reports_lie_beside_the_rows(store):
    """Uncompressed, for the browser."""
    found = outcome("/a.bin")
    page = Outcome(
        source=found.source, sha256=found.sha256, status="analyzed", vehicle="v", table=found.table,
        reports={0: gzip.compress(b"<html>")},
    )  # fmt: skip
    store.take(page)
    assert (store.folder / "reports" / f"{'a' * 64}-0.html").read_bytes() == b"<html>"


def test_a_folder_that_is_no_store_is_refused(tmp_path):
    """By everything that reads one."""
    with pytest.raises(SettingsError, match="no store"):
        dataset(tmp_path)
