"""Velocity over ground, turned into the body axes."""

from __future__ import annotations

import math

import numpy as np
import pytest

from quadid_logs.align import cut
from quadid_logs.data.flight import Segment
from quadid_logs.data.log import FlightLog, Rows, Signal
from quadid_logs.data.settings import AlignSettings
from quadid_logs.load import prepare

N = 2000


def segment(*, attitude: tuple[float, float, float] | None, end: int = N) -> Segment:
    """Return 20 s of flight north at 1 m/s that holds this attitude; velocity is logged up to `end`."""
    rows = Rows(0.01 * np.arange(N), np.arange(N, dtype=np.int64))
    wave = np.sin(0.05 * np.arange(N))[:, np.newaxis] * np.ones(3)
    values = {"body_rate": wave, "torque_command": wave, "velocity": np.tile([1.0, 0.0, 0.0], (N, 1))}
    if attitude is not None:
        values["attitude"] = np.tile(attitude, (N, 1))
    signals = {
        name: (
            Signal(
                name=name,
                rows=Rows(rows.time_s[:end], rows.position[:end]) if name == "velocity" else rows,
                values=value[:end] if name == "velocity" else value,
                source=name,
                reason="by hand",
            ),
        )
        for name, value in values.items()
    }
    log = FlightLog(
        path="", format="table", autopilot="other", n_bytes=0, signals=signals, vehicle_type="multirotor"
    )
    return cut(prepare(log), AlignSettings()).segments[0]


@pytest.mark.parametrize(
    ("attitude", "along"),
    [
        ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)),
        # Nose to the east: north is on the left.
        ((0.0, 0.0, math.pi / 2.0), (0.0, -1.0, 0.0)),
        # Nose up by 30 degrees: what is flown forward goes along x and, with the belly ahead, along z.
        ((0.0, math.pi / 6.0, 0.0), (math.cos(math.pi / 6.0), 0.0, 0.5)),
        # Nose to the east and right side down by 30 degrees: what comes from the right goes along y and up.
        ((math.pi / 6.0, 0.0, -math.pi / 2.0), (0.0, math.cos(math.pi / 6.0), -0.5)),
    ],
)
def test_velocity_over_ground_is_turned_into_the_body_axes(
    attitude: tuple[float, float, float], along: tuple[float, float, float]
) -> None:
    """A vehicle that flies north, whichever way it looks and leans."""
    velocity = segment(attitude=attitude).velocity_m_s
    assert velocity is not None
    np.testing.assert_allclose(velocity, np.tile(along, (len(velocity), 1)), atol=1e-6)


def test_without_an_attitude_no_velocity_is_known_along_the_body_axes() -> None:
    """North is not forward."""
    assert segment(attitude=None).velocity_m_s is None


def test_a_velocity_that_ends_before_the_flight_is_not_held_on() -> None:
    """Nothing is made up for the second half."""
    assert segment(attitude=(0.0, 0.0, 0.0), end=N // 2).velocity_m_s is None
