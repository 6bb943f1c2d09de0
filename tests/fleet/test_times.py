"""When a flight was, asked by SQL."""

from __future__ import annotations

import datetime
import json

from quadid_logs.cli import main
from tests.fleet.synthetic_store import FIRST, make_store


def test_the_time_of_a_flight_can_be_asked_for(tmp_path, capsys):
    """With its offset to UTC, whatever the machine's zone."""
    store = make_store(tmp_path / "store", ["quad-01"], n_flights=1)
    assert main(["query", str(store), "SELECT max(started) AS t FROM fleet", "--json"]) == 0
    assert datetime.datetime.fromisoformat(json.loads(capsys.readouterr().out)["t"]) == FIRST
