"""SQL over a store: every answer, and no way out of it."""

from __future__ import annotations

import csv
import io
import json
import os

import pytest

from quadid_logs.cli import main
from quadid_logs.fleets.log_files import LogFile
from quadid_logs.fleets.options import Options
from quadid_logs.fleets.rows import UNREADABLE
from quadid_logs.fleets.store import Store
from quadid_logs.fleets.tasks import Task, failure
from tests.fleet.synthetic_store import make_store


@pytest.fixture
def store(tmp_path):
    """Three rows, one with a hostile text."""
    with Store(tmp_path / "store", Options(), resume=False) as store:
        for number, error in enumerate(("plain", 'comma, "quote"', "\x1b[31mred")):
            task = Task(file=LogFile(url=f"/{number}.bin", n_bytes=number), options=Options())
            store.take(failure(task, str(number) * 64, UNREADABLE, error))
    return store.folder


def ask(store, sql, *options):
    return main(["query", str(store), sql, *options])


def test_a_table_is_printed(store, capsys):
    """Numbers to the right, texts to the left, no control characters."""
    assert ask(store, "SELECT url, n_bytes, error FROM fleet ORDER BY url") == 0
    out = capsys.readouterr().out
    assert out.splitlines()[0].split() == ["url", "n_bytes", "error"]
    assert len(out.splitlines()) == 4
    assert "\x1b" not in out


def test_json_is_one_object_a_row(store, capsys):
    """Dates as text, NaN as null, inside a list too."""
    columns = "n_bytes, started, ['nan'::DOUBLE] AS list, 'nan'::DOUBLE AS none"
    columns += ", TIMESTAMP '2026-01-02 03:04:05' AS t"
    assert ask(store, f"SELECT {columns} FROM fleet WHERE n_bytes = 0", "--json") == 0
    assert json.loads(capsys.readouterr().out) == {
        "n_bytes": 0, "started": None, "list": [None], "none": None, "t": "2026-01-02 03:04:05",
    }  # fmt: skip


def test_csv_is_quoted(store, capsys):
    """It reads back as it was."""
    assert ask(store, "SELECT url, error FROM fleet ORDER BY url", "--csv") == 0
    rows = list(csv.reader(io.StringIO(capsys.readouterr().out)))
    assert rows[0] == ["url", "error"]
    assert rows[2] == ["/1.bin", 'comma, "quote"']


def test_csv_runs_nothing_in_a_spreadsheet_or_a_terminal(store, capsys):
    """Names come from strangers: no formula, no escape sequence; numbers stay numbers."""
    texts = "'=cmd|x' AS a, '@x' AS b, '+1' AS c, '-1' AS d, error AS e, -1.5 AS f, ['\x1b[2J'] AS g"
    assert ask(store, f"SELECT {texts} FROM fleet WHERE n_bytes = 2", "--csv") == 0
    out = capsys.readouterr().out
    assert "\x1b" not in out
    cells = list(csv.reader(io.StringIO(out)))[1]
    assert cells[:4] == ["'=cmd|x", "'@x", "'+1", "'-1"]
    assert cells[5] == "-1.5"


@pytest.mark.parametrize("sql", ["", "  ", "/* a comment */", ";"])
def test_a_query_without_a_statement_is_no_bug_of_ours(store, capsys, sql):
    """One clear line."""
    assert ask(store, sql) == 2
    err = capsys.readouterr().err
    assert "no statement" in err
    assert "bug" not in err


def test_a_wrong_query_is_refused_without_the_library_s_drawing(store, capsys):
    """Flattened to one line, the query again and a caret mean nothing."""
    assert ask(store, "SELECT nothing FROM fleet") == 2
    err = capsys.readouterr().err
    assert "nothing" in err
    assert "LINE 1" not in err
    assert "^" not in err


@pytest.mark.parametrize(
    "sql",
    [
        "COPY fleet TO '{0}/stolen.csv'",
        "COPY fleet TO '{0}/stolen.parquet' (FORMAT parquet)",
        "EXPORT DATABASE '{0}/stolen'",
        "ATTACH '{0}/stolen.db'",
        "SELECT * FROM read_csv('{0}/secret.csv')",
        "SELECT * FROM '{0}/secret.csv'",
        "SELECT * FROM read_text('{0}/secret.csv')",
        "SELECT * FROM glob('{0}/*')",
        "SELECT * FROM read_parquet('http://127.0.0.1:9/x.parquet')",
        "INSTALL httpfs",
        "LOAD httpfs",
        "SET enable_external_access = true",
        "SET temp_directory = '{0}/stolen'",
        "RESET lock_configuration",
        "PRAGMA enable_profiling; PRAGMA profiling_output='{0}/stolen.json'; SELECT 1",
        "SET enable_external_access = true; COPY fleet TO '{0}/stolen.csv'",
        "INSERT INTO fleet VALUES (1)",
        "DELETE FROM fleet",
        "SELEKT 1",
        "",
    ],
)
def test_sql_reads_and_writes_nothing_but_the_store(store, tmp_path, capsys, sql):
    """Refused in one line, and no file is there that was not."""
    (tmp_path / "secret.csv").write_text("secret\n42\n")
    before = sorted(os.walk(tmp_path))
    code = ask(store, sql.format(tmp_path))
    captured = capsys.readouterr()
    assert sorted(os.walk(tmp_path)) == before
    assert "42" not in captured.out
    assert code == 2 or not captured.out
    assert "Traceback" not in captured.err


def test_a_folder_that_is_no_store_is_one_clear_line(tmp_path, capsys):
    """With the command that makes one."""
    assert ask(tmp_path, "SELECT 1") == 2
    assert "quadid-log fleet" in capsys.readouterr().err


def test_a_missing_library_is_one_clear_line(store, capsys, monkeypatch):
    """With the extra to install."""
    monkeypatch.setitem(__import__("sys").modules, "duckdb", None)
    assert ask(store, "SELECT 1") == 2
    assert "'.[fleet]'" in capsys.readouterr().err


def test_a_question_about_failed_logs_is_answered_from_all_of_them(tmp_path, capsys):
    """Which logs gave nothing, of which kind the failure was, and why; analyzed ones are not among them."""
    folder = make_store(tmp_path / "store", ["quad"], n_flights=1)
    task = Task(file=LogFile(url="/lost.bin", n_bytes=7), options=Options())
    with Store(folder, Options(), resume=True) as opened:
        opened.take(failure(task, "", "lost", "It was not analyzed within 60 s."))
    wanted = "SELECT url, status, error FROM fleet WHERE status <> 'analyzed' ORDER BY status"
    capsys.readouterr()
    assert ask(folder, wanted, "--csv") == 0
    found = list(csv.DictReader(io.StringIO(capsys.readouterr().out)))
    assert [row["status"] for row in found] == ["lost", "unreadable"]
    assert found[0] == {"url": "/lost.bin", "status": "lost", "error": "It was not analyzed within 60 s."}
    assert all(row["error"] for row in found)
