"""Margins and flown gains in a fleet's rows: which vehicle has less than 6 dB?"""

from __future__ import annotations

import json
import sqlite3
from contextlib import closing

import pytest

from quadid_logs.autopilots import named
from quadid_logs.cli import main
from quadid_logs.control.scaled_loop import scaled_loops
from quadid_logs.fleets.history import read_fleet
from quadid_logs.fleets.log_files import LogFile
from quadid_logs.fleets.naming import NamingRules
from quadid_logs.fleets.options import Options
from quadid_logs.fleets.rows import result_rows
from quadid_logs.fleets.store import DATABASE, Store, read_rows
from quadid_logs.fleets.tasks import Outcome
from tests.directed_flights import vehicle, with_gains
from tests.fleet.synthetic_store import make_store

QUESTION = "SELECT url, axis FROM fleet WHERE gain_margin_db < 6 AND axis = 'roll'"
#: Those that a store of before has not.
NEW = (
    "gains", "limited_fraction",
    *(f"{name}{end}" for name in ("gain_margin_db", "phase_margin_deg", "disk_margin")
      for end in ("", "_low", "_high")),
)  # fmt: skip


def rows_of_gains(factor, url, sha256):
    """The rows of a flight whose gains of roll are so many times as high, and the true margin [dB]."""
    result = with_gains("ardupilot", {"roll": factor})
    controllers = named("ardupilot").controllers(result.log, result.log.parameters)
    roll = controllers.axes["roll"]
    true = scaled_loops(roll, vehicle("ardupilot", 0, roll.period_s), 1e9).margins()
    file = LogFile(url=url, n_bytes=1)
    return result_rows([result], file, sha256, NamingRules()), true.full.gain_margin_db.value


def test_one_query_tells_which_vehicle_has_little_margin(tmp_path, capsys):
    with Store(tmp_path / "store", Options(margins=True), resume=False) as store:
        for factor, url in ((1.0, "/calm.bin"), (7.0, "/close.bin")):
            rows, true_db = rows_of_gains(factor, url, f"{factor:.0f}" * 64)
            assert (true_db < 6.0) == (url == "/close.bin")
            (roll,) = (row for row in rows if row["axis"] == "roll")
            assert roll["gain_margin_db_low"] <= true_db <= roll["gain_margin_db_high"]
            store.take(Outcome(file=LogFile(url=url, n_bytes=1), sha256=f"{factor:.0f}" * 64, rows=rows))
    assert main(["query", str(tmp_path / "store"), QUESTION, "--json"]) == 0
    assert [json.loads(line)["url"] for line in capsys.readouterr().out.splitlines()] == ["/close.bin"]


def test_a_row_holds_the_gains_that_flew():
    rows, _ = rows_of_gains(2.0, "/a.bin", "a" * 64)
    before = with_gains("ardupilot", {}).log.parameters
    (roll,) = (row for row in rows if row["axis"] == "roll")
    assert json.loads(roll["gains"])["ATC_RAT_RLL_P"] == pytest.approx(
        2.0 * before["ATC_RAT_RLL_P"], rel=1e-3
    )


@pytest.fixture
def earlier(tmp_path):
    """A store as versions without margins wrote it."""
    folder = make_store(tmp_path / "store", ("quad-1",))
    with closing(sqlite3.connect(folder / DATABASE)) as database, database:
        for name in NEW:
            database.execute(f"ALTER TABLE fleet DROP COLUMN {name}")
        database.execute("UPDATE made_with SET value = '3' WHERE name = 'format'")
        database.execute("DELETE FROM made_with WHERE name = 'margins'")
    return folder


def test_an_earlier_store_is_read(earlier, capsys):
    (history,) = read_fleet(earlier).histories
    assert len(history.flights) == 12
    assert main(["query", str(earlier), "SELECT count(*) AS n FROM fleet WHERE gain_margin_db IS NULL"]) == 0
    assert "37" in capsys.readouterr().out


def test_an_earlier_store_is_gone_on_with(earlier):
    rows, _ = rows_of_gains(1.0, "/new.bin", "b" * 64)
    with Store(earlier, Options(), resume=True) as store:
        store.take(Outcome(file=LogFile(url="/new.bin", n_bytes=1), sha256="b" * 64, rows=rows))
    found = list(read_rows(earlier, ("url", "gain_margin_db")))
    assert len(found) == 40
    assert {row["url"] for row in found if row["gain_margin_db"] is not None} == {"/new.bin"}


def test_the_page_marks_small_margins(tmp_path):
    def told(row, flight):
        row["gain_margin_db"] = 4.2 if row["vehicle"] == "quad-2" and row["axis"] == "pitch" else 12.0
        row["phase_margin_deg"] = 50.0

    folder = make_store(tmp_path / "store", ("quad-1", "quad-2"), change=told)
    page = tmp_path / "page.html"
    assert main(["fleet-report", str(folder), "-o", str(page)]) in {0, 1}
    text = page.read_text()
    assert "pitch 4.2 dB, 50°" in text
    assert text.count(">small<") == 1
