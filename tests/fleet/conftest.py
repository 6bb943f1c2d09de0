"""A small fleet of simulated vehicles, flown once for all tests of a process."""

from __future__ import annotations

import pytest

from benchmarks.fleet_logs import Vehicle, write_flight


@pytest.fixture(scope="session")
def logs(tmp_path_factory):
    """Two vehicles, two flights each, a file that is no log, and one that is cut off: a folder."""
    folder = tmp_path_factory.mktemp("logs")
    paths = [
        write_flight(Vehicle(number=number), flight, folder, duration_s=16.0, rate_hz=100.0)
        for number in (0, 1)
        for flight in (0, 1)
    ]
    (folder / "noise.bin").write_bytes(b"no log at all" * 100)
    (folder / "cut.bin").write_bytes(paths[0].read_bytes()[:70])
    (folder / "notes.txt").write_text("not looked at: no ending of a log")
    return folder


@pytest.fixture
def one_log(logs):
    """One flight's log."""
    return sorted(logs.glob("2026*.bin"))[0]
