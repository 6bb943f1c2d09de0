"""Gains stay in the ranges that the firmwares document, each axis in its own."""

from __future__ import annotations

import pytest

from quadid_logs.autopilots import named

#: Upper ends in the parameters' metadata: mc_rate_control_params.c, mc_att_control_params.c and what
#: followed them in YAML; AC_AttitudeControl_Multi.cpp and AC_AttitudeControl.cpp.
PX4 = {
    "MC_ROLLRATE_K": 5.0, "MC_ROLLRATE_P": 0.5, "MC_ROLLRATE_D": 0.01, "MC_ROLL_P": 12.0,
    "MC_PITCHRATE_K": 5.0, "MC_PITCHRATE_P": 0.6, "MC_PITCH_P": 12.0,
    "MC_YAWRATE_K": 5.0, "MC_YAWRATE_P": 0.6, "MC_YAW_P": 5.0,
}  # fmt: skip
ARDUPILOT = {
    "ATC_RAT_RLL_P": 0.5, "ATC_RAT_RLL_I": 2.0, "ATC_RAT_RLL_D": 0.05, "ATC_ANG_RLL_P": 12.0,
    "ATC_RAT_PIT_P": 0.5, "ATC_RAT_PIT_I": 2.0, "ATC_RAT_PIT_D": 0.05, "ATC_ANG_PIT_P": 12.0,
    "ATC_RAT_YAW_P": 2.5, "ATC_RAT_YAW_I": 1.0, "ATC_RAT_YAW_D": 0.02, "ATC_ANG_YAW_P": 12.0,
}  # fmt: skip


@pytest.mark.parametrize(("autopilot", "documented"), [("px4", PX4), ("ardupilot", ARDUPILOT)])
def test_each_gain_has_the_upper_end_that_its_firmware_documents(
    autopilot: str, documented: dict[str, float]
) -> None:
    """The angle gain of yaw ends at 5 in PX4, at less than half of roll's."""
    tunable = named(autopilot).tunable({})
    assert tunable is not None
    assert {name: end for axis in tunable.axes.values() for name, end in axis.highest.items()} == documented
