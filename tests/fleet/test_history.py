"""What a store says about vehicles: the order of their flights, which axes count, when it is no all-clear."""

from __future__ import annotations

import datetime
import re

import pytest

from quadid_logs.cli import main
from quadid_logs.fleets.history import read_fleet
from tests.fleet.synthetic_store import FIRST, make_store, scaled

NAMES = ("quad-1", "quad-2")


def report(tmp_path, capsys, store):
    """Return exit code, lines and page of fleet-report."""
    page = tmp_path / "fleet.html"
    code = main(["fleet-report", str(store), "-o", str(page), "--force"])
    return code, capsys.readouterr().out.splitlines(), page.read_text()


def halved(first):
    """Halve roll's effectiveness from a flight on."""

    def change(row, flight):
        if row["vehicle"] == "quad-2" and row["axis"] == "roll" and flight >= first:
            scaled(row, "gain", 0.49)

    return change


@pytest.mark.parametrize(
    ("first", "words"), [(4, "one more flight will decide"), (5, "two more flights will decide")]
)
def test_last_flights_with_half_the_effectiveness_are_an_alarm(tmp_path, capsys, first, words):
    """Six flights, the last one or two at half of roll's effectiveness: no all-clear, a code of its own."""
    store = make_store(tmp_path / "store", NAMES, 6, change=halved(first))
    code, lines, page = report(tmp_path, capsys, store)
    assert code == 3
    (line,) = [line for line in lines if "quad-2" in line]
    assert "last flight differs" in line or "last 2 flights differ" in line
    assert re.search(r"by −51\.\d ± \d\.\d % in roll effectiveness", line)
    assert words in line
    assert words in page
    assert "No vehicle changed" not in page


def test_three_flights_with_half_the_effectiveness_are_a_change(tmp_path, capsys):
    """No longer open."""
    store = make_store(tmp_path / "store", NAMES, 6, change=halved(3))
    code, lines, _ = report(tmp_path, capsys, store)
    assert code == 1
    assert any(line.startswith("quad-2 changed with flight 4 of 6") for line in lines)
    assert not any("may have changed" in line for line in lines)


def refuse(row, _flight):
    """Refuse an axis for a reason that depends on it."""
    code = {"roll": "QL303", "pitch": "QL303", "yaw": "QL201"}[row["axis"]]
    row |= {"verdict": "refused", "reasons": [code, "QL403"]}


def test_a_fleet_without_a_usable_axis_is_no_all_clear(tmp_path, capsys):
    """The first line says what blocks them, by reason; the code is not that of a healthy fleet."""
    store = make_store(tmp_path / "store", NAMES, 3, change=refuse)
    code, lines, page = report(tmp_path, capsys, store)
    assert code == 4
    assert lines[0] == (
        "No axis of 18 is usable; 18 are refused: logged too slowly to identify anything (QL303) on 12, "
        "this is not a multirotor (QL201) on 6."
    )
    assert lines[0] in page
    assert "No vehicle changed" not in page
    assert "nothing could be compared" in page


def test_vehicles_with_few_flights_are_not_said_to_be_unchanged(tmp_path, capsys):
    """Four flights can show no change."""
    _, _, page = report(tmp_path, capsys, make_store(tmp_path / "store", NAMES, 4))
    assert "No vehicle changed" not in page
    assert "2 vehicles with fewer than 6 comparable flights" in page


def copied(row, flight):
    """A log without a date, copied in the reverse order."""
    row["url"] = f"/logs/{flight + 1:08d}.BIN"
    row |= {
        "started": FIRST + datetime.timedelta(days=300 - flight),
        "started_from": "modification",
    }


def test_logs_without_a_date_follow_their_numbers(tmp_path):
    """Not the dates of their copies."""
    fleet = read_fleet(make_store(tmp_path / "store", ("quad-1",), 12, change=copied))
    names = [flight.url for flight in fleet.histories[0].flights]
    assert names == [f"/logs/{number:08d}.BIN" for number in range(1, 13)]


def test_a_log_without_a_date_stands_among_the_dated_ones_by_its_number(tmp_path):
    """Its receiver was off on one day; it was copied a year later."""

    def change(row, flight):
        if flight == 4:
            copied(row, flight)
        else:
            row["url"] = f"/logs/{flight + 1:08d}.BIN"

    fleet = read_fleet(make_store(tmp_path / "store", ("quad-1",), 8, change=change))
    numbers = [int(flight.url[-12:-4]) for flight in fleet.histories[0].flights]
    assert numbers == list(range(1, 9))


def test_the_date_of_a_file_is_not_shown_as_that_of_a_flight(tmp_path, capsys):
    """Neither of a flight nor of the vehicle."""
    store = make_store(tmp_path / "store", ("quad-1",), 3, change=copied)
    _, _, page = report(tmp_path, capsys, store)
    assert "dates unknown" in page
    assert page.count("date unknown (file of ") == 3
