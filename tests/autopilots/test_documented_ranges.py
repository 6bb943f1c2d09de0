"""Gains stay in the ranges that the firmwares document, each axis and version in its own."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from quadid_logs.autopilots import named
from quadid_logs.control.documented import within_documented
from quadid_logs.data.tuning import AxisTuning, GainChange, GainNames

#: @min and @max in mc_rate_control_params.c and mc_att_control_params.c of 1.14, 1.15 and 1.16.
PX4 = {
    "MC_ROLLRATE_K": (0.01, 5.0), "MC_ROLLRATE_P": (0.01, 0.5), "MC_ROLLRATE_I": (0.0, math.inf),
    "MC_ROLLRATE_D": (0.0, 0.01), "MC_ROLL_P": (0.0, 12.0),
    "MC_PITCHRATE_K": (0.01, 5.0), "MC_PITCHRATE_P": (0.01, 0.6), "MC_PITCHRATE_I": (0.0, math.inf),
    "MC_PITCHRATE_D": (0.0, math.inf), "MC_PITCH_P": (0.0, 12.0),
    "MC_YAWRATE_K": (0.0, 5.0), "MC_YAWRATE_P": (0.0, 0.6), "MC_YAWRATE_I": (0.0, math.inf),
    "MC_YAWRATE_D": (0.0, math.inf), "MC_YAW_P": (0.0, 5.0),
}  # fmt: skip
#: Its successor in YAML (main).
PX4_LATER = PX4 | {"MC_YAWRATE_K": (0.01, 5.0)}
#: apm.pdef.xml of Copter-4.1 to 4.8, the first entry of each name, which is the multirotors'.
COPTER = {
    "ATC_RAT_RLL_P": (0.01, 0.5), "ATC_RAT_RLL_I": (0.01, 2.0), "ATC_RAT_RLL_D": (0.0, 0.05),
    "ATC_ANG_RLL_P": (3.0, 12.0),
    "ATC_RAT_PIT_P": (0.01, 0.5), "ATC_RAT_PIT_I": (0.01, 2.0), "ATC_RAT_PIT_D": (0.0, 0.05),
    "ATC_ANG_PIT_P": (3.0, 12.0),
    "ATC_RAT_YAW_P": (0.1, 2.5), "ATC_RAT_YAW_I": (0.01, 1.0), "ATC_RAT_YAW_D": (0.0, 0.02),
    "ATC_ANG_YAW_P": (3.0, 12.0),
}  # fmt: skip
#: That of Copter-4.0.
COPTER_4_0 = COPTER | {
    "ATC_ANG_RLL_P": (0.0, 12.0), "ATC_ANG_PIT_P": (0.0, 12.0), "ATC_ANG_YAW_P": (0.0, 6.0)
}  # fmt: skip
NAMES = GainNames(
    scaled=(), proportional="P", integral="I", derivative="D", angle="A", ranges={"P": (0.1, 0.5)}
)


@pytest.mark.parametrize(
    ("autopilot", "version", "documented"),
    [
        ("px4", (1, 14, 3), PX4),
        ("px4", (1, 15, 4), PX4),
        ("px4", (1, 16, 0), PX4),
        ("px4", (1, 18, 0), PX4_LATER),
        ("ardupilot", (4, 0, 7), COPTER_4_0),
        ("ardupilot", (4, 1), COPTER),
        ("ardupilot", (4, 4, 4), COPTER),
        ("ardupilot", (4, 6, 1), COPTER),
        ("ardupilot", (4, 7, 0), COPTER),
        ("ardupilot", None, COPTER),
    ],
)
def test_each_gain_has_the_range_that_its_version_documents(
    autopilot: str, version: tuple[int, ...] | None, documented: dict[str, tuple[float, float]]
) -> None:
    """The angle gain of yaw ends at 5 in PX4, at less than half of roll's."""
    tunable = named(autopilot).tunable({}, version)
    assert tunable is not None
    assert {name: ends for axis in tunable.axes.values() for name, ends in axis.ranges.items()} == documented


@pytest.mark.parametrize(("flown", "factors"), [(0.2, (0.5, 2.5)), (0.05, (1.0, 10.0)), (1.0, (0.1, 1.0))])
def test_what_flew_outside_of_its_range_comes_no_further_out(
    flown: float, factors: tuple[float, float]
) -> None:
    assert NAMES.factors("P", flown) == pytest.approx(factors)


def told(now: float, following: float, target: float) -> list[str]:
    gains = {"P": GainChange(now, following, target)}
    tuned = within_documented("roll", AxisTuning(verdict="change", reasons=(), gains=gains), NAMES)
    return [one.code for one in tuned.reasons]


def test_a_target_at_the_end_of_its_range_is_said_to_be_held_there() -> None:
    assert told(0.3, 0.45, 0.5) == ["QL637"]
    assert told(0.3, 0.45, 0.49) == []


def test_a_gain_that_another_multiplies_is_not_held_at_the_end_of_its_range() -> None:
    """MC_ROLLRATE_K takes the loop further than MC_ROLLRATE_P alone, up to the end of its own range."""
    names = replace(NAMES, scaled=("K",), ranges={**NAMES.ranges, "K": (0.01, 5.0)})

    def held(common: float) -> list[str]:
        gains = {"P": GainChange(0.3, 0.5, 0.5), "K": GainChange(1.0, common, common)}
        tuned = AxisTuning(verdict="change", reasons=(), gains=gains)
        return [one.code for one in within_documented("roll", tuned, names).reasons]

    assert held(1.5) == []
    assert held(5.0) == ["QL637"]


def test_a_gain_that_falls_below_its_range_is_named() -> None:
    """Margins come first; the ground station may ask."""
    assert told(0.12, 0.09, 0.09) == ["QL676"]
    assert told(0.12, 0.11, 0.11) == []


def test_a_gain_that_stays_outside_of_its_range_is_the_pilots_own() -> None:
    assert told(0.09, 0.09, 0.09) == []
    assert told(0.6, 0.6, 0.6) == []
