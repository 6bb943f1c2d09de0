"""What a fleet asks of each flight, and what a flight too short to judge may say."""

from __future__ import annotations

import re

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


@pytest.mark.parametrize("seconds", [1.5, 2.5])
def test_a_vehicle_that_turns_over_at_take_off_is_told_so(seconds: float) -> None:
    """It rolls at 400 deg/s from 0.3 s after leaving the ground on: 60 degrees are passed at 0.45 s."""
    time_s = np.arange(0.0, 30.0, 1.0 / RATE_HZ)
    up = (time_s >= 10.0) & (time_s < 10.0 + seconds)
    rate = np.zeros((time_s.size, 3))
    rate[(time_s >= 10.3) & (time_s < 10.75), 0] = np.radians(400.0)
    prepared = prepare(
        flight_log(
            signal("body_rate", time_s, rate),
            signal("throttle", time_s, np.where(up, 0.4, 0.0)[:, np.newaxis]),
            signal("armed", time_s, np.where(up, 1.0, 0.0)[:, np.newaxis]),
        )
    )
    health = health_of(prepared, cut(prepared, AlignSettings()))
    assert health.tilt is not None
    assert health.tilt.level == "severe"
    assert np.degrees(health.tilt.figures["highest"].value) == pytest.approx(180.0, abs=1.0)
    (passed,) = re.findall(r"60 deg (\S+) s after leaving the ground", health.tilt.sentence)
    # Take-off is known to a tenth of a second.
    assert 0.35 <= float(passed) <= 0.45


@pytest.mark.parametrize(("tilt_deg", "level"), [(20.0, "normal"), (59.0, "normal"), (61.0, "severe")])
def test_a_hop_is_judged_by_how_far_it_leans(tilt_deg: float, level: str) -> None:
    """Beyond 60 degrees autopilots detect a failure."""
    time_s = np.arange(0.0, 30.0, 1.0 / RATE_HZ)
    up = (time_s >= 10.0) & (time_s < 11.5)
    rate = np.zeros((time_s.size, 3))
    rate[(time_s >= 10.3) & (time_s < 10.8), 1] = np.radians(2.0 * tilt_deg)
    rate[(time_s >= 10.9) & (time_s < 11.4), 1] = np.radians(-2.0 * tilt_deg)
    prepared = prepare(
        flight_log(
            signal("body_rate", time_s, rate),
            signal("landed", time_s, np.where(up, 0.0, 1.0)[:, np.newaxis]),
        )
    )
    health = health_of(prepared, cut(prepared, AlignSettings()))
    assert health.tilt is not None
    assert health.tilt.level == level
    assert np.degrees(health.tilt.figures["highest"].value) == pytest.approx(tilt_deg, abs=0.7)


def test_a_short_part_of_a_flight_is_no_hop() -> None:
    """The vehicle did not stand level where it begins, and the gyro's errors grow."""
    time_s = np.arange(0.0, 60.0, 1.0 / RATE_HZ)
    up = (time_s >= 10.0) & (time_s < 50.0)
    prepared = prepare(
        flight_log(
            signal("body_rate", time_s, motion(time_s)),
            signal("landed", time_s, np.where(up, 0.0, 1.0)[:, np.newaxis]),
        )
    )
    part = cut(prepared, AlignSettings(start_s=20.0, end_s=21.5))
    assert part.flights
    assert not health_of(prepared, part).topics


def test_a_flight_of_three_seconds_is_judged() -> None:
    prepared = log(((10.0, 15.0),))
    assert "motors" in health_of(prepared, cut(prepared, AlignSettings())).topics
