"""What a fleet asks of each flight, and what a flight too short to judge may say."""

from __future__ import annotations

import numpy as np
import pytest

from quadid_logs.align import Prepared, cut
from quadid_logs.data.settings import AlignSettings
from quadid_logs.health import faults_of, health_of
from quadid_logs.load import prepare
from tests.align.flights import flight_log, motion, signal

RATE_HZ = 100.0


def log(flights: tuple[tuple[float, float], ...], stopped: tuple[float, float] | None = None) -> Prepared:
    """Return a log whose throttle is up in these parts; the second rotor may stand still for a while."""
    time_s = np.arange(0.0, flights[-1][1] + 10.0, 1.0 / RATE_HZ)
    up = np.any([(time_s >= first) & (time_s < last) for first, last in flights], axis=0)
    thrust = np.where(up, 0.4, 0.0)[:, np.newaxis] * np.ones(4) + 1e-3 * np.sin(time_s)[:, np.newaxis]
    speed = np.where(up, 900.0, 0.0)[:, np.newaxis] * np.ones(4)
    if stopped is not None:
        within = (time_s >= stopped[0]) & (time_s < stopped[1])
        thrust[within], speed[within] = (0.2, 0.9, 0.2, 0.2), (600.0, 0.0, 600.0, 600.0)
    return prepare(
        flight_log(
            signal("body_rate", time_s, motion(time_s) * up[:, np.newaxis]),
            signal("torque_command", time_s, 0.1 * motion(time_s)),
            signal("throttle", time_s, np.where(up, 0.4, 0.0)[:, np.newaxis]),
            signal("motor_thrust", time_s, thrust),
            signal("rotor_speed", time_s, speed),
        )
    )


def flight(prepared: Prepared, number: int) -> AlignSettings:
    start_s, end_s = prepared.flights[number]
    return AlignSettings(start_s=start_s, end_s=end_s)


@pytest.mark.parametrize(("number", "codes"), [(0, ()), (1, ("QL436",)), (2, ())])
def test_a_fleet_is_told_of_a_standstill_in_the_flight_in_which_it_was(
    number: int, codes: tuple[str, ...]
) -> None:
    prepared = log(((10.0, 40.0), (50.0, 80.0), (90.0, 120.0)), stopped=(60.0, 64.0))
    health = faults_of(prepared, cut(prepared, flight(prepared, number)))
    assert (() if health.standstill is None else health.standstill.findings) == codes


def test_a_fleet_is_told_of_a_motor_that_never_started_before_a_flight() -> None:
    prepared = log(((10.0, 40.0), (50.0, 80.0)), stopped=(43.0, 46.0))
    health = faults_of(prepared, cut(prepared, flight(prepared, 1)))
    assert health.standstill is not None


def test_a_hop_judges_no_vehicle() -> None:
    """Half a second between the seconds that are cut off at both ends."""
    prepared = log(((10.0, 12.5),))
    assert prepared.flights
    health = health_of(prepared, cut(prepared, AlignSettings()))
    assert not health.topics
    assert "too short" in health.missing["motors"]


def test_a_flight_of_three_seconds_is_judged() -> None:
    prepared = log(((10.0, 15.0),))
    assert "motors" in health_of(prepared, cut(prepared, AlignSettings())).topics
