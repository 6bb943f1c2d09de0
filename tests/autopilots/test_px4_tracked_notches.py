"""PX4's dynamic notches stand where the ESCs say that the rotors were."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from quadid_logs.autopilots.px4.controller import controllers
from quadid_logs.autopilots.px4.filters import follows_unknown, parameter_filter, rotor_notches
from quadid_logs.control.loop import gyro_filters
from quadid_logs.data.controller import RemarkKind
from quadid_logs.load import read_log
from quadid_logs.simulator import simulate
from quadid_logs.writers import write_log

ON = {"IMU_GYRO_DNF_EN": 1.0, "IMU_GYRO_DNF_BW": 15.0, "IMU_GYRO_DNF_HMC": 2.0, "IMU_GYRO_DNF_MIN": 25.0}
SPEEDS = {"rotors_hz": np.array([[80.0, 90.0], [100.0, 110.0]])}


def test_each_rotor_has_a_notch_at_each_harmonic() -> None:
    ((first, _),) = rotor_notches(ON, SPEEDS)
    assert sorted(notch.frequency_hz for notch in first) == [80.0, 90.0, 160.0, 180.0]


def test_all_of_them_have_the_same_width() -> None:
    ((first, _),) = rotor_notches(ON, SPEEDS)
    assert [notch.frequency_hz * notch.inverse_q for notch in first] == pytest.approx([15.0] * 4)


def test_slow_rotors_leave_their_notches_at_the_lowest_frequency_half_a_width_apart() -> None:
    (((*notches,),),) = rotor_notches(ON | {"IMU_GYRO_DNF_HMC": 3.0}, {"rotors_hz": np.array([[1.0]])})
    assert [notch.frequency_hz for notch in notches] == [25.0, 32.5, 40.0]


def test_the_lowest_frequency_is_no_less_than_the_width() -> None:
    (((lowest, _),),) = rotor_notches(ON | {"IMU_GYRO_DNF_BW": 30.0}, {"rotors_hz": np.array([[1.0]])})
    assert lowest.frequency_hz == 30.0


@pytest.mark.parametrize(("enabled", "unknown"), [(0.0, False), (1.0, False), (2.0, True), (3.0, True)])
def test_notches_on_peaks_of_a_spectrum_stay_unknown(enabled: float, unknown: bool) -> None:
    assert follows_unknown(ON | {"IMU_GYRO_DNF_EN": enabled}, SPEEDS) is unknown


def test_notches_on_rotors_that_nobody_logged_stay_unknown() -> None:
    assert follows_unknown(ON, {})


@pytest.mark.parametrize("name", ["EN", "BW", "HMC", "MIN"])
@pytest.mark.parametrize("value", [math.nan, math.inf, -1.0, 0.0, 1e30])
def test_no_parameter_makes_a_notch_that_is_no_number(name: str, value: float) -> None:
    known = parameter_filter(ON | {f"IMU_GYRO_DNF_{name}": value}, SPEEDS)
    for notch in (one for places in known.tracked for each in places for one in each):
        assert all(map(math.isfinite, notch))


@pytest.mark.thorough
def test_a_logged_speed_of_the_rotors_ends_the_doubt_and_costs_phase(tmp_path: Path) -> None:
    """A simulated flight's file: without a notch in its parameters, and with one."""
    path = tmp_path / "flight.ulg"
    write_log(simulate("doublets", seed=1, duration_s=20.0, autopilot="px4").log, path)
    log = read_log(path)
    notched = {**log.parameters, **ON}
    without, found = (controllers(log, each) for each in (log.parameters, notched))
    assert RemarkKind.NOTCH_UNKNOWN not in {one.kind for one in found.remarks}
    frequency_hz = np.array([10.0])
    ratio = gyro_filters(found.axes["roll"], frequency_hz) / gyro_filters(without.axes["roll"], frequency_hz)
    # A notch of width w takes atan(w f / (f_n^2 - f^2)): here at once and twice the speed of each rotor.
    speeds_hz = log.followed["rotors_hz"]
    centres_hz = np.concatenate([speeds_hz, 2.0 * speeds_hz], axis=1)
    each_deg = np.degrees(np.arctan(15.0 * 10.0 / (centres_hz**2 - 10.0**2)))
    lost_deg = float(each_deg.sum(axis=1).mean())
    assert -float(np.degrees(np.angle(ratio[0]))) == pytest.approx(lost_deg, rel=0.05)
    unseen = controllers(replace(log, followed={}), notched)
    assert RemarkKind.NOTCH_UNKNOWN in {one.kind for one in unseen.remarks}
