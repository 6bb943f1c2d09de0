"""A rotor that does not turn although it is told to, from series of which everything is known."""

from __future__ import annotations

import numpy as np
import pytest

from quadid_logs.data.health import Standstill
from quadid_logs.health.standstill import find_standstill
from tests.health.flights import series

NAMES = ("motor 1", "motor 2", "motor 3", "motor 4")
RATE_HZ = 100.0
STOPS_S, LASTS_S = 4.0, 3.0


def found(*, speed_rad_s: float, output: float, lasts_s: float = LASTS_S) -> Standstill | None:
    """Return what is told of ten seconds; the second rotor is sent this for some, and turns so fast."""
    time_s = np.arange(1000) / RATE_HZ
    outputs = np.full((1000, 4), 0.3)
    speeds = np.full((1000, 4), 900.0)
    within = (time_s >= STOPS_S) & (time_s < STOPS_S + lasts_s)
    outputs[within, 1], speeds[within, 1] = output, speed_rad_s
    return find_standstill(
        series("motor_thrust", time_s, outputs), series("rotor_speed", time_s, speeds), NAMES
    )


def test_a_rotor_that_stops_under_full_command_is_named_with_time_and_length() -> None:
    standstill = found(speed_rad_s=0.0, output=1.0)
    assert standstill is not None
    assert (standstill.rotor, standstill.findings) == (1, ("QL436",))
    assert standstill.time_s == pytest.approx(STOPS_S, abs=0.02)
    assert standstill.length.value == pytest.approx(LASTS_S, abs=0.05)


def test_a_rotor_that_is_sent_less_may_turn_as_slowly_as_it_likes() -> None:
    assert found(speed_rad_s=0.0, output=0.05) is None


def test_a_weak_rotor_that_turns_two_thirds_as_fast_does_not_stand_still() -> None:
    assert found(speed_rad_s=600.0, output=1.0) is None


def test_a_motor_that_needs_half_a_second_to_start_does_not_stand_still() -> None:
    assert found(speed_rad_s=0.0, output=1.0, lasts_s=0.5) is None


def test_rotors_that_run_down_after_landing_one_before_the_other_accuse_none() -> None:
    """ "Motor 4 turned at only 0 rpm, the others at 20 rpm or more": of a vehicle that was disarmed."""
    time_s = np.arange(1000) / RATE_HZ
    outputs = np.full((1000, 4), 0.3)
    outputs[:, 3] = 0.31
    speeds = np.full((1000, 4), 900.0)
    after = time_s >= STOPS_S
    speeds[after] = 60.0 * np.exp(-(time_s[after] - STOPS_S))[:, np.newaxis]
    speeds[after, 3] = 0.0
    standstill = find_standstill(
        series("motor_thrust", time_s, outputs), series("rotor_speed", time_s, speeds), NAMES
    )
    assert standstill is None


def test_speeds_of_no_rotor_at_all_accuse_none() -> None:
    time_s = np.arange(1000) / RATE_HZ
    outputs = np.full((1000, 4), 0.3)
    outputs[:, 1] = 0.5
    speed = series("rotor_speed", time_s, np.zeros((1000, 4)))
    assert find_standstill(series("motor_thrust", time_s, outputs), speed, NAMES) is None


def test_speeds_that_were_not_measured_accuse_none() -> None:
    time_s = np.arange(1000) / RATE_HZ
    outputs = np.full((1000, 4), 0.3)
    outputs[:, 1] = 0.5
    speed = series("rotor_speed", time_s, np.full((1000, 4), np.nan))
    assert find_standstill(series("motor_thrust", time_s, outputs), speed, NAMES) is None
