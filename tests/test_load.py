"""From a file to a log with its torque: what the user chose and what the log tells reaches every stage."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from quadid_logs.align import cut
from quadid_logs.data.settings import AlignSettings, Settings
from quadid_logs.errors import SettingsError
from quadid_logs.load import load, prepare
from tests.align.flights import flown
from tests.containers import mavlink_maker as make

STAMPS = np.arange(10.0, 40.0, 0.0025)


@pytest.mark.parametrize(("loop_hz", "every"), [(400.0, True), (800.0, False), (None, False)])
def test_the_loops_rate_among_the_parameters_says_whether_each_step_was_logged(
    loop_hz: float | None, every: bool
) -> None:
    """SCHED_LOOP_RATE beside a torque at 400 Hz."""
    parameters = {} if loop_hz is None else {"SCHED_LOOP_RATE": loop_hz}
    log = replace(flown(STAMPS), parameters=parameters)
    given = cut(prepare(log), AlignSettings()).input
    assert given is not None
    assert given.every_step is every


def two_systems(folder: Path) -> Path:
    """Write the telemetry of two vehicles of one link; the first one says more."""
    content = b""
    for system, n_rows in ((1, 60), (7, 30)):
        sender = make.Sender(system)
        content += sender.heartbeat() + b"".join(sender.attitude(k) for k in range(n_rows))
    path = folder / "two.tlog"
    path.write_bytes(content)
    return path


def test_the_system_of_the_settings_is_read(tmp_path: Path) -> None:
    """And without one, that which says most."""
    path = two_systems(tmp_path)
    assert load(path, Settings(system=7)).log.vehicle_name == "system 7"
    assert load(path).log.vehicle_name == "system 1"
    with pytest.raises(SettingsError):
        load(path, Settings(system=3))
