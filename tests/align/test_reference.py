"""What is commanded from outside the loop."""

from __future__ import annotations

import numpy as np
import pytest

from quadid_logs.align import cut
from quadid_logs.data.log import FlightLog, Rows, Signal
from quadid_logs.data.settings import AlignSettings
from quadid_logs.load import prepare


def log(*names: str) -> FlightLog:
    """Return 20 s of flight at 100 Hz in which every signal has a level of its own."""
    n = 2000
    rows = Rows(0.01 * np.arange(n), np.arange(n, dtype=np.int64))
    wave = np.sin(0.05 * np.arange(n))[:, np.newaxis] * np.ones(3)
    signals = {
        name: (Signal(name=name, rows=rows, values=wave * level, source=name, reason="by hand"),)
        for level, name in enumerate(("body_rate", "torque_command", *names), start=1)
    }
    return FlightLog(
        path="", format="table", autopilot="other", n_bytes=0, signals=signals, vehicle_type="multirotor"
    )


@pytest.mark.parametrize(
    ("names", "level"),
    [
        (("body_rate_setpoint",), 3.0),
        (("reference_rate",), 3.0),
        (("body_rate_setpoint", "reference_rate"), 4.0),
    ],
)
def test_a_trajectory_comes_before_set_points_that_answer_the_motion(
    names: tuple[str, ...], level: float
) -> None:
    """Whichever is logged; of both the trajectory."""
    segment = cut(prepare(log(*names)), AlignSettings()).segments[0]
    assert segment.reference is not None
    assert np.abs(segment.reference).max() == pytest.approx(level, rel=1e-3)


def test_where_only_angles_were_commanded_their_change_is_the_reference() -> None:
    """A sine of 3 rad at 0.05 rad a sample of 10 ms changes by up to 15 rad/s; over a turn it goes on."""
    segment = cut(prepare(log("attitude_setpoint")), AlignSettings()).segments[0]
    assert segment.reference is not None
    assert np.abs(segment.reference).max() == pytest.approx(15.0, rel=1e-2)
