"""What a vehicle is called: by its owner, in all its logs, those to come included."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from quadid_logs.fleets.history import read_fleet
from quadid_logs.fleets.log_files import LogFile
from quadid_logs.fleets.rows import judged_as
from quadid_logs.fleets.tasks import Outcome
from quadid_logs.serve.jobs import Done
from tests.fleet.synthetic_store import make_store
from tests.serve.asgi import SHA, Site, site

OTHER = "b" * 64


def rename(own: Site, name: str, **options: object) -> int:
    """Ask as the page does, and return the status."""
    body = json.dumps({"name": name}).encode()
    return own.ask(f"/vehicles/{SHA}/name", "POST", [body], **options).status  # type: ignore[arg-type]


def vehicles(own: Site) -> list[str]:
    """Return what the list shows."""
    return [entry.summary["vehicle"] for entry in own.schedule.entries()]


def test_all_logs_of_a_vehicle_get_its_new_name(own: Site) -> None:
    """However many were dropped; the history knows it by that name too."""
    own.finished()
    own.finished(OTHER)
    make_store(own.store.history, ["v", "another"], 2)
    assert rename(own, "Gecko") == 204
    assert vehicles(own) == ["Gecko", "Gecko"]
    assert [history.vehicle for history in read_fleet(own.store.history).histories] == ["Gecko", "another"]


def test_a_later_log_of_a_renamed_vehicle_gets_the_name_too(tmp_path: Path) -> None:
    """Also after a restart, and after another name: its log says what it always said."""
    with site(tmp_path / "store") as own:
        own.finished()
        rename(own, "Gecko")
        rename(own, "Gecko II")
    with site(tmp_path / "store") as own:
        assert vehicles(own) == ["Gecko II"]
        rows = ({"vehicle": "v", "status": "analyzed"},)
        done = own.store.named(
            Done(summary={"vehicle": "v"}, outcome=Outcome(file=LogFile(url="x"), sha256=OTHER, rows=rows))
        )
        assert done.summary["vehicle"] == "Gecko II"
        assert done.outcome is not None
        assert [row["vehicle"] for row in done.outcome.rows] == ["Gecko II"]
        assert own.store.named(Done(summary={"vehicle": "w"})).summary["vehicle"] == "w"


def test_only_the_owner_renames(own: Site) -> None:
    """Neither without the cookie nor from another page."""
    own.finished()
    assert rename(own, "x", cookie=False) == 401
    assert rename(own, "x", origin="http://evil.example") == 403
    assert vehicles(own) == ["v"]


@pytest.mark.parametrize("name", ["", "  ", "\x00\x07"])
def test_a_vehicle_is_not_called_nothing(own: Site, name: str) -> None:
    """It could not be found in the list."""
    own.finished()
    rename(own, name)
    assert all(vehicle.strip() for vehicle in vehicles(own))


def test_a_name_is_short_plain_text(own: Site) -> None:
    """Control characters and pages of text are none; what looks like HTML is shown as it stands."""
    own.finished()
    make_store(own.store.history, ["v"], 2)
    assert rename(own, "<script>alert(1)</script>\x1b[31m" + "x" * 500) == 204
    (name,) = vehicles(own)
    assert len(name) <= 80
    assert name.isprintable()
    shown = own.ask(f"/vehicles/{SHA}").text
    assert "&lt;script&gt;" in shown
    assert "<script>alert" not in shown


def test_a_vehicle_with_a_fault_says_so_on_its_page(own: Site) -> None:
    """The fleet's page did; this one said nothing at all of such a vehicle."""
    own.finished()

    def with_fault(row: dict[str, object], _flight: int) -> None:
        row.update(faults="QL430", faults_found="Motor 1 gives 24 % less thrust than the others.")

    make_store(own.store.history, ["v"], 2, change=with_fault)
    assert "In the last flight: Motor 1 gives 24 % less thrust" in own.ask(f"/vehicles/{SHA}").text


def test_the_history_judges_a_flight_as_its_report_does() -> None:
    """The structure that all flights share may be refused where the best one is not: its numbers go."""
    row = {"verdict": "refused", "reasons": ["QL402"], "sentence": "s", "gain": 1.0, "gain_low": 0.9}
    report = {"verdict": "caution", "reasons": ["QL401"], "sentence": "t", "gain": 2.0}
    (refused,) = judged_as([row], [report])
    assert (refused["verdict"], refused["reasons"], refused["gain"]) == ("caution", ["QL401"], None)
    (kept,) = judged_as([{**row, "verdict": "caution"}], [{**report, "verdict": "refused"}])
    assert (kept["verdict"], kept["gain"], kept["gain_low"]) == ("refused", 1.0, 0.9)
