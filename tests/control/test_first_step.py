"""Where an axis oscillates and no model is, the first step goes to half of the gain, never up."""

from __future__ import annotations

import pytest

from quadid_logs.autopilots import named
from quadid_logs.control.first_step import first_step
from quadid_logs.control.room import has_way_back
from quadid_logs.data.health import AxisOscillation, Line, LineSource
from quadid_logs.data.tuning import GOOD, AxisTuning
from quadid_logs.diagnose.findings import finding

REFUSED = AxisTuning(verdict="refused", reasons=(finding("QL615", "warning", {}),))
FLOWN = {
    "ardupilot": {"ATC_RAT_RLL_P": 0.4, "ATC_RAT_RLL_I": 0.3, "ATC_RAT_RLL_D": 0.01, "ATC_ANG_RLL_P": 9.0},
    "px4": {"MC_ROLLRATE_K": 1.0, "MC_ROLLRATE_P": 0.2, "MC_ROLLRATE_I": 0.2, "MC_ROLL_P": 9.0},
    "betaflight": {"p_roll": 81.0, "i_roll": 80.0, "d_roll": 41.0},
}


def oscillating(setpoint_share: float) -> AxisOscillation:
    """Return an oscillation of roll at 9 Hz."""
    line = Line(frequency_hz=9.0, height_db=30.0, p_value=1e-9, share=1.0, rms=0.3, source=LineSource.LOOP)
    return AxisOscillation(axis="roll", line=line, setpoint_share=setpoint_share, power_share=0.9)


def step(autopilot: str, setpoint_share: float = 0.05) -> AxisTuning:
    """Return the step of roll."""
    tunable = named(autopilot).tunable(FLOWN[autopilot])
    assert tunable is not None
    return first_step(REFUSED, oscillating(setpoint_share), tunable.axes["roll"], FLOWN[autopilot])


@pytest.mark.parametrize(
    ("autopilot", "expected"),
    [
        ("ardupilot", {"ATC_RAT_RLL_P": 0.2, "ATC_RAT_RLL_I": 0.15, "ATC_RAT_RLL_D": 0.005}),
        ("px4", {"MC_ROLLRATE_K": 0.5}),
        ("betaflight", {"p_roll": 40.0, "i_roll": 40.0, "d_roll": 20.0}),
    ],
)
def test_a_rate_loop_that_oscillates_gets_half_of_its_gains(
    autopilot: str, expected: dict[str, float]
) -> None:
    """By each firmware's own names; whole numbers are rounded to less gain."""
    found = step(autopilot)
    assert {name: change.next for name, change in found.changes.items()} == pytest.approx(expected)
    assert found.direction == "lower"


def test_a_loop_around_the_rate_loop_gets_half_of_the_angle_gain() -> None:
    """The rate follows its set-point there: the rate loop is not what oscillates."""
    assert {name: one.next for name, one in step("ardupilot", 0.9).changes.items()} == {"ATC_ANG_RLL_P": 4.5}


def test_firmware_without_the_gain_is_refused_as_before() -> None:
    """Betaflight's set-points come from the sticks."""
    assert step("betaflight", 0.9) is REFUSED


def test_a_step_by_rule_says_so_promises_nothing_and_has_a_way_back() -> None:
    """The reasons of the refusal stay behind it."""
    found = step("px4")
    assert found.by_rule
    assert found.next is None
    assert [one.code for one in found.reasons] == ["QL648", "QL615"]
    assert has_way_back(found, GOOD)


def test_a_gain_that_the_log_does_not_tell_is_not_written() -> None:
    """Nor one that is zero."""
    tunable = named("ardupilot").tunable({})
    assert tunable is not None
    flown = {"ATC_RAT_RLL_P": 0.4, "ATC_RAT_RLL_D": 0.0}
    found = first_step(REFUSED, oscillating(0.05), tunable.axes["roll"], flown)
    assert list(found.changes) == ["ATC_RAT_RLL_P"]
