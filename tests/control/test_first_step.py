"""Where an axis oscillates and no model is, the first step goes to half of the gain, never up."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import pytest

from quadid_logs.autopilots import named
from quadid_logs.control.first_step import first_step, quieter_step
from quadid_logs.control.room import has_way_back
from quadid_logs.data.health import AxisOscillation, Line, LineSource
from quadid_logs.data.tuning import GOOD, AxisTuning, FilterChoices
from quadid_logs.diagnose.findings import finding
from quadid_logs.vocabulary import AXES

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


#: A low-pass of all axes and one of each, as the firmware comes with them.
CHOICES = FilterChoices(
    shared=({"GYRO": (10.0, 200.0)},),
    own={axis: ({f"D_{axis}": (5.0, 100.0)},) for axis in AXES},
    defaults={"GYRO": 20.0, **{f"D_{axis}": 30.0 for axis in AXES}},
)


def quieter(
    gyro_hz: float, d_hz: float, choices: FilterChoices = CHOICES, line_hz: float = 0.0
) -> dict[str, AxisTuning]:
    """Return the step of a vehicle of which no axis has a model, for a notch takes a line away."""
    flown = {"GYRO": gyro_hz, **{f"D_{axis}": d_hz for axis in AXES}}

    def noise(_axis: str, filters: Mapping[str, float]) -> float:
        return 0.1 if filters.get("NOTCH", 0.0) == line_hz > 0.0 else 0.25

    return quieter_step(dict.fromkeys(AXES, REFUSED), choices, flown, noise)


def test_where_noise_leaves_no_axis_a_model_cut_offs_are_halved() -> None:
    for axis, found in quieter(80.0, 90.0).items():
        assert {name: one.next for name, one in found.changes.items()} == {"GYRO": 40.0, f"D_{axis}": 45.0}


def test_no_cut_off_goes_below_what_the_firmware_comes_with() -> None:
    found = quieter(25.0, 30.0)["roll"]
    assert {name: one.next for name, one in found.changes.items()} == {"GYRO": 20.0}


@pytest.mark.parametrize("choices", [CHOICES, FilterChoices(shared=CHOICES.shared, own=CHOICES.own)])
def test_cut_offs_at_or_without_a_default_stay(choices: FilterChoices) -> None:
    assert all(found is REFUSED for found in quieter(20.0, 30.0, choices).values())


def test_the_notch_is_set_that_leaves_least_noise_and_none_that_leaves_as_much() -> None:
    choices = replace(CHOICES, notches=({"NOTCH": 70.0}, {"NOTCH": 90.0}))
    assert quieter(20.0, 30.0, choices, 90.0)["yaw"].filters["NOTCH"].next == 90.0
    assert quieter(20.0, 30.0, choices, 50.0)["yaw"] is REFUSED


def test_a_step_to_less_noise_says_that_it_is_by_rule_and_has_a_way_back() -> None:
    found = quieter(80.0, 90.0)["roll"]
    assert found.by_rule
    assert [one.code for one in found.reasons] == ["QL649", "QL615"]
    assert has_way_back(found, GOOD)


@pytest.mark.parametrize(("setpoint_share", "drives"), [(0.05, True), (0.9, False)])
def test_what_is_most_of_the_output_of_a_rate_loop_drives_it_though_the_pilot_moves_the_vehicle_more(
    setpoint_share: float, drives: bool
) -> None:
    line = Line(frequency_hz=18.0, height_db=30.0, p_value=1e-9, share=1.0, rms=0.3, source=LineSource.LOOP)
    found = AxisOscillation(
        axis="roll", line=line, setpoint_share=setpoint_share, power_share=0.4, output_share=0.9
    )
    assert not found.dominates
    assert found.drives_outputs is drives
