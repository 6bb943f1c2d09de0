"""The store: all rows of a log or none, one name per content, and whoever reads sees a good one."""

from __future__ import annotations

import gzip
import sqlite3
import subprocess
import sys

import pytest

from benchmarks.fleet_rows import rows_of
from quadid_logs.cli import main
from quadid_logs.errors import OutputError, QuadidError, SettingsError
from quadid_logs.fleets.log_files import LogFile
from quadid_logs.fleets.options import Options
from quadid_logs.fleets.rows import COLUMNS, LOST, UNREADABLE, schema
from quadid_logs.fleets.store import DATABASE, Store, count_verdicts, read_rows, read_table
from quadid_logs.fleets.tasks import Outcome, Task, failure
from tests.fleet.synthetic_store import make_store


def outcome(url, sha256="a" * 64, *, status=UNREADABLE, n_bytes=10, error="no log"):
    task = Task(file=LogFile(url=url, n_bytes=n_bytes), options=Options())
    return failure(task, "" if status == LOST else sha256, status, error)


@pytest.fixture
def store(tmp_path):
    with Store(tmp_path / "store", Options(), resume=False) as store:
        yield store


def test_of_two_names_for_one_content_the_first_stays(store):
    """In whatever order the workers finish."""
    for url in ("/b.bin", "/c.bin", "/a.bin"):
        assert store.take(outcome(url))
    assert [row["url"] for row in rows_of(store.folder)] == ["/a.bin"]


def test_a_known_content_under_an_earlier_name_is_done_again(store):
    """So that a resumed run ends with the store of an uninterrupted one."""
    store.take(outcome("/b.bin"))
    assert not store.take(Outcome(file=LogFile(url="/a.bin"), sha256="a" * 64))
    assert store.take(Outcome(file=LogFile(url="/c.bin"), sha256="a" * 64))


def test_what_was_lost_is_forgotten_when_it_is_found(store):
    """The row of the failure goes."""
    store.take(outcome("/a.bin", status=LOST))
    assert [row["status"] for row in rows_of(store.folder)] == [LOST]
    store.take(outcome("/a.bin"))
    assert [row["status"] for row in rows_of(store.folder)] == [UNREADABLE]


def test_two_lost_logs_are_two_rows(store):
    """Nobody saw their contents: their names tell them apart, and a second try replaces the first."""
    for url in ("/a.bin", "/b.bin", "/a.bin"):
        store.take(outcome(url, status=LOST))
    assert [row["url"] for row in rows_of(store.folder)] == ["/a.bin", "/b.bin"]


def test_a_lost_log_is_not_known(store):
    """The next run tries again; a log that can never be read is not tried again."""
    store.take(outcome("/a.bin", status=LOST, n_bytes=11))
    store.take(outcome("/b.bin", n_bytes=12))
    with Store(store.folder, Options(), resume=True) as again:
        assert again.known(LogFile(url="/a.bin", n_bytes=11)) == ()
        assert again.known(LogFile(url="/moved.bin", n_bytes=12)) == ("a" * 64,)


def test_models_of_another_band_do_not_go_into_a_store(store):
    """Numbers of two bands do not compare; the settings of each analysis have the band."""
    options = Options(band_hz=(1.0, 8.0))
    fit = options.settings.identify
    assert (fit.high_pass_hz, fit.smoothing_hz) == (1.0, 8.0)
    with pytest.raises(SettingsError, match="another band: '', not '1 8'"):
        Store(store.folder, options, resume=True)


def test_a_store_from_before_there_was_a_band_goes_on(store):
    """Its logs chose their own, as without --band."""
    with sqlite3.connect(store.folder / DATABASE) as database:
        database.execute("DELETE FROM made_with WHERE name = 'band'")
    with Store(store.folder, Options(), resume=True) as again:
        again.take(outcome("/a.bin"))
    assert len(rows_of(store.folder)) == 1


def test_another_version_does_the_work_again_and_replaces_its_rows(store, monkeypatch):
    """Numbers of two versions are not mixed, whatever the log is called now."""
    store.take(outcome("/a.bin"))
    for module in ("store", "rows", "work"):
        monkeypatch.setattr(f"quadid_logs.fleets.{module}.__version__", "9.9.9")
    with Store(store.folder, Options(), resume=True) as again:
        assert again.known(LogFile(url="/a.bin", n_bytes=10)) == ()
        again.take(outcome("/b.bin"))
    assert [(row["url"], row["version"]) for row in rows_of(store.folder)] == [("/b.bin", "9.9.9")]


#: Begins to replace what the store has, and is killed before the end of the transaction.
_KILLED = """
import os, signal, sqlite3, sys
database = sqlite3.connect(sys.argv[1], isolation_level=None)
database.execute("BEGIN IMMEDIATE")
database.execute("PRAGMA cache_size = 1")  # so that pages go to the disk before the end
database.execute("DELETE FROM fleet")
database.execute("INSERT INTO fleet (url, error) SELECT 'half', hex(zeroblob(1000000))")
os.kill(os.getpid(), signal.SIGKILL)
"""


def test_a_run_killed_while_it_writes_leaves_the_rows_of_before(store):
    """And the next run writes on."""
    store.take(outcome("/a.bin"))
    before = rows_of(store.folder)
    subprocess.run([sys.executable, "-c", _KILLED, str(store.folder / DATABASE)], check=False)
    assert rows_of(store.folder) == before
    store.take(outcome("/b.bin", "b" * 64))
    assert [row["url"] for row in rows_of(store.folder)] == ["/a.bin", "/b.bin"]


def test_a_failure_within_a_log_leaves_what_was_there(store):
    """All rows of a log or none: the second cannot be stored."""
    store.take(outcome("/b.bin"))
    good = outcome("/a.bin", error="newer")
    broken = Outcome(file=good.file, sha256=good.sha256, rows=(*good.rows, {"error": object()}))
    with pytest.raises(SettingsError):
        store.take(broken)
    assert [row["error"] for row in rows_of(store.folder)] == ["no log"]


def test_a_run_goes_on_while_somebody_reads(store):
    """A reader in the middle of its answer sees one state, and keeps nobody waiting."""
    for number in range(3):
        store.take(outcome(f"/{number}.bin", f"{number:064x}"))
    reader = read_rows(store.folder, ["url"])
    assert next(reader)["url"] == "/0.bin"
    store.take(outcome("/3.bin", f"{3:064x}"))
    assert [row["url"] for row in reader] == ["/1.bin", "/2.bin"]
    assert len(rows_of(store.folder)) == 4


def test_two_runs_into_one_store_spoil_nothing(store):
    """Each sees what the other has written."""
    with Store(store.folder, Options(), resume=True) as other:
        store.take(outcome("/b.bin"))
        other.take(outcome("/c.bin"))
        other.take(outcome("/a.bin"))
        store.take(outcome("/d.bin", "d" * 64))
    assert [row["url"] for row in rows_of(store.folder)] == ["/a.bin", "/d.bin"]


def test_a_closed_store_is_one_file(store):
    """To be copied, or read from where nothing can be written."""
    store.take(outcome("/a.bin"))
    store.close()
    assert [path.name for path in store.folder.iterdir()] == [DATABASE]


def test_a_full_disk_is_one_clear_line_and_changes_nothing(store):
    """SQLite's own limit of pages stands for the disk."""
    store.take(outcome("/a.bin"))
    (pages,) = store._database.execute("PRAGMA page_count").fetchone()
    store._database.execute(f"PRAGMA max_page_count = {pages}")
    big = outcome("/b.bin", "b" * 64)
    with pytest.raises(OutputError, match="full"):
        store.take(Outcome(file=big.file, sha256=big.sha256, rows=big.rows * 1000))
    assert [row["url"] for row in rows_of(store.folder)] == ["/a.bin"]


def test_a_name_that_is_no_text_is_stored(store):
    """A file system allows any byte; a second try finds the first."""
    for _ in range(2):
        store.take(outcome("/\udcff.bin", status=LOST))
    assert [row["url"] for row in rows_of(store.folder)] == ["/?.bin"]


def test_reports_lie_beside_the_rows(store):
    """Uncompressed, for the browser."""
    found = outcome("/a.bin")
    store.take(
        Outcome(file=found.file, sha256=found.sha256, rows=found.rows, reports={0: gzip.compress(b"<html>")})
    )
    assert (store.folder / "reports" / f"{'a' * 64}-0.html").read_bytes() == b"<html>"


def test_both_ways_of_reading_give_the_same_rows(tmp_path):
    """Times, lists, numbers, nulls: by Python's types and by Arrow's."""
    folder = make_store(tmp_path / "store", ["quad-1", "quad-2"], n_flights=4)

    def in_order(rows):
        return sorted(rows, key=lambda row: (row["sha256"], row["axis"] or ""))

    table = read_table(folder)
    assert table.schema == schema()
    assert in_order(table.to_pylist()) == in_order(read_rows(folder, list(COLUMNS)))


def test_an_empty_store_is_an_empty_table(store):
    """With its columns."""
    assert read_table(store.folder).num_rows == 0
    assert read_table(store.folder).schema == schema()


@pytest.mark.parametrize("read", [lambda folder: list(read_rows(folder, ["url"])), read_table])
def test_a_folder_that_is_no_store_is_refused(tmp_path, read):
    """By everything that reads one."""
    with pytest.raises(SettingsError, match="not a fleet store"):
        read(tmp_path)


@pytest.mark.parametrize("open_", [read_table, lambda folder: Store(folder, Options(), resume=True)])
def test_a_damaged_store_is_one_clear_line(store, open_):
    """For who reads and for who writes."""
    store.close()
    (store.folder / DATABASE).write_bytes(b"no database" * 1000)
    with pytest.raises(SettingsError, match="not a database"):
        open_(store.folder)


_FOREIGN = {
    "axis": "'elbow'", "status": "'eaten'", "verdict": "'superb'", "gain": "'much'", "gain_low": "1e300",
    "flight": "'first'", "started": "'yesterday'", "reasons": "'[[' || hex(zeroblob(9)) || ']]'",
    "vehicle": "NULL", "url": "x'ff00'", "duration_s": "NULL", "n_flights": "NULL", "lag_s": "x'00'",
}  # fmt: skip


@pytest.mark.parametrize("column", _FOREIGN)
def test_a_foreign_row_is_named_and_set_aside(tmp_path, capsys, column):
    """It makes no verb fail: the report, a query and a resumed run go on with the others."""
    folder = make_store(tmp_path / "store", ["quad-1"], n_flights=3)
    with sqlite3.connect(folder / DATABASE) as database:
        database.execute(f"UPDATE fleet SET {column} = {_FOREIGN[column]} WHERE rowid = 2")
    database.close()
    for arguments in (["query", str(folder), "SELECT count(*) FROM fleet"], _report(folder)):
        assert main(arguments) in (0, 1)
        err = capsys.readouterr().err
        assert "is skipped" in err
        assert column in err
    assert "set aside" in (tmp_path / "x.html").read_text()
    assert read_table(folder).num_rows == 9
    Store(folder, Options(), resume=True).close()


def _report(folder):
    return ["fleet-report", str(folder), "-o", str(folder.parent / "x.html")]


def test_deeply_nested_reasons_are_set_aside(tmp_path):
    """Python's reader of JSON gives up by an error of its own."""
    folder = make_store(tmp_path / "store", ["quad-1"], n_flights=3)
    with sqlite3.connect(folder / DATABASE) as database:
        database.execute("UPDATE fleet SET reasons = ? WHERE rowid = 2", ("[" * 100_000,))
    database.close()
    found = []
    assert len(list(read_rows(folder, ["url"], found.append))) == 9
    assert len(found) == 1
    assert len(list(count_verdicts(folder))) >= 1


@pytest.mark.parametrize("content", ["CREATE TABLE other (x)", "CREATE TABLE fleet (x)", ""])
def test_another_program_s_database_is_one_clear_line(tmp_path, capsys, content):
    """No traceback, no word about a bug."""
    folder = tmp_path / "store"
    folder.mkdir()
    with sqlite3.connect(folder / DATABASE) as database:
        database.execute(content)
        database.execute("CREATE TABLE IF NOT EXISTS made_with (x)")
    database.close()
    for arguments in (["query", str(folder), "SELECT 1"], _report(folder)):
        assert main(arguments) == 2
        assert "bug" not in capsys.readouterr().err
    with pytest.raises(QuadidError):
        Store(folder, Options(), resume=True)


def test_any_program_that_reads_sqlite_reads_the_store(tmp_path):
    """Times are ISO 8601, reasons a JSON list."""
    folder = make_store(tmp_path / "store", ["quad-1"], n_flights=4)
    with sqlite3.connect(folder / DATABASE) as database:
        found = database.execute(
            "SELECT date(started), json_extract(reasons, '$[0]') FROM fleet WHERE verdict = 'refused'"
        ).fetchall()
    database.close()
    assert found == [("2026-03-04", "QL303")]
