"""What position controllers were given and gave, through each format's file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from quadid_logs.data.log import FlightLog
from quadid_logs.load import read_log
from quadid_logs.writers import write_log
from tests.control.held_flights import log_of


@pytest.fixture(scope="module", params=[("ardupilot", "flight.bin"), ("px4", "flight.ulg")])
def logs(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> tuple[FlightLog, FlightLog]:
    """Return a flight that holds positions, as simulated and as read from its file."""
    autopilot, name = request.param
    log = log_of(autopilot)
    path: Path = tmp_path_factory.mktemp("positions") / name
    write_log(log, path)
    return log, read_log(path)


def test_what_was_written_of_positions_is_read_again(logs: tuple[FlightLog, FlightLog]) -> None:
    written, read = logs
    directions = {rows.direction: rows for rows in read.position_control}
    for rows in written.position_control:
        again = directions[rows.direction]
        assert again.rows.time_s == pytest.approx(rows.rows.time_s, abs=1e-5)
        for name, values in rows.values.items():
            assert again.values[name] == pytest.approx(values, abs=1e-5), name


def test_what_was_written_of_attitude_set_points_is_read_again(logs: tuple[FlightLog, FlightLog]) -> None:
    written, read = logs
    before, after = (log.candidates("attitude_setpoint")[0] for log in logs)
    assert after.n_samples == before.n_samples
    assert after.values == pytest.approx(before.values, abs=1e-5)
    assert np.ptp(before.values[:, 0]) > 0.01
    assert written.parameters.keys() <= read.parameters.keys()
