"""What QuikTune does, by the options that a log holds: AP_Quicktune.cpp and VTOL-quicktune.lua."""

from __future__ import annotations

import math

import pytest

from quadid_logs.autopilots import named
from quadid_logs.data.autotune import Doubling


def quiktune(axis: str, **parameters: float) -> Doubling:
    found = named("ardupilot").tunable({"INS_GYRO_FILTER": 40.0, **parameters})
    assert found is not None
    (procedure,) = (one for one in found.procedures[axis] if isinstance(one, Doubling))
    return procedure


def test_target_and_derivative_are_filtered_at_half_of_the_gyro_filter() -> None:
    assert quiktune("roll").filters == {"ATC_RAT_RLL_FLTT": 20.0, "ATC_RAT_RLL_FLTD": 20.0}


@pytest.mark.parametrize(("flown_hz", "set_hz"), [(0.0, 2.0), (5.0, 2.0), (1.5, None)])
def test_in_yaw_the_error_is_filtered_at_two_hertz_at_most(flown_hz: float, set_hz: float | None) -> None:
    assert quiktune("yaw", ATC_RAT_YAW_FLTE=flown_hz).filters.get("ATC_RAT_YAW_FLTE") == set_hz


def test_without_its_own_filters_the_flown_ones_stay() -> None:
    assert quiktune("roll", QUIK_AUTO_FILTER=0.0).filters == {}


@pytest.mark.parametrize("name", ["QWIK_GAIN_MARGIN", "QUIK_GAIN_MARGIN"])
def test_the_gain_margin_of_the_firmware_and_of_the_script_is_read(name: str) -> None:
    assert quiktune("pitch", **{name: 50.0}).kept == 0.5


@pytest.mark.parametrize("name", ["QWIK_REDUCE_MAX", "QUIK_MAX_REDUCE"])
def test_the_greatest_reduction_is_read_by_both_names(name: str) -> None:
    assert quiktune("roll", **{name: 30.0}).least_of_flown == pytest.approx(0.7)


def test_a_reduction_of_all_is_none() -> None:
    assert quiktune("roll", QWIK_REDUCE_MAX=100.0).least_of_flown == 0.0


def test_i_is_p_in_roll_and_a_tenth_of_it_in_yaw() -> None:
    assert [quiktune(axis).integral_ratio for axis in ("roll", "yaw")] == [1.0, 0.1]


@pytest.mark.parametrize("parameters", [{"ATC_RAT_RLL_FF": 0.1}, {"QUIK_RP_PI_RATIO": 0.5}])
def test_i_stays_beside_a_feed_forward_or_a_ratio_below_one(parameters: dict[str, float]) -> None:
    assert quiktune("roll", **parameters).integral_ratio is None


def test_yaw_alone_has_highest_gains() -> None:
    roll, yaw = quiktune("roll"), quiktune("yaw")
    assert (roll.highest_proportional, roll.highest_derivative) == (math.inf, math.inf)
    assert (yaw.highest_proportional, yaw.highest_derivative) == (0.5, 0.01)


def test_p_falls_with_d_in_roll_and_not_in_yaw() -> None:
    assert [quiktune(axis).lowers_p for axis in ("roll", "pitch", "yaw")] == [True, True, False]
