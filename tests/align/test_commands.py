"""What was commanded, with the answer of the angle controller taken out of the rate set-points."""

from __future__ import annotations

import numpy as np

from quadid_logs.align.commands import AngleGains, with_commands
from quadid_logs.autopilots import named
from quadid_logs.data.flight import Segment
from quadid_logs.data.log import ModeChange

PERIOD_S, GAIN = 0.01, (6.0, 5.0, 3.0)
TIME_S = 10.0 + PERIOD_S * np.arange(3000)


def _segment() -> tuple[Segment, np.ndarray]:
    """Return a flight whose set-points are gain times (commanded angle - angle), and the former part."""
    omega = 2.0 * np.pi * np.array([0.6, 1.1, 2.3])
    angle = 0.3 * np.sin(np.outer(TIME_S, omega))
    rate = 0.3 * omega * np.cos(np.outer(TIME_S, omega))
    wanted = np.array(GAIN) * 0.2 * np.sin(np.outer(TIME_S, (3.0, 4.0, 5.0)))
    return Segment(
        time_s=TIME_S,
        body_rate_rad_s=rate,
        torque=np.zeros_like(rate),
        attitude_rad=None,
        throttle=None,
        saturated=np.zeros(TIME_S.size, dtype=bool),
        reference=wanted - np.array(GAIN) * angle,
    ), wanted


def _command_of(segment: Segment, modes: list[ModeChange], gains: AngleGains) -> np.ndarray | None:
    (found,) = with_commands([segment], modes, gains)
    return found.command


def _modes(*changes: tuple[float, str]) -> list[ModeChange]:
    return [ModeChange(time_s=time_s, position=0, name=name) for time_s, name in changes]


def test_the_angle_controllers_answer_is_taken_out() -> None:
    """What is left is the commanded angle times the gain, but for drifts of quarter minutes."""
    segment, wanted = _segment()
    command = _command_of(segment, _modes((0.0, "STABILIZE")), {"STABILIZE": GAIN})
    assert command is not None
    assert segment.reference is not None
    quick = np.diff(command - wanted, axis=0)
    assert np.std(quick) < 0.05 * np.std(np.diff(segment.reference - wanted, axis=0))


def test_set_points_of_an_acro_flight_are_the_command() -> None:
    """With gains of zero nothing changes."""
    segment, _ = _segment()
    command = _command_of(segment, _modes((0.0, "Acro")), {"Acro": (0.0, 0.0, 0.0)})
    np.testing.assert_array_equal(command, segment.reference)


def test_nothing_is_known_of_a_mode_that_answers_the_position() -> None:
    """From 20 s on."""
    segment, _ = _segment()
    command = _command_of(segment, _modes((0.0, "STABILIZE"), (20.0, "LOITER")), {"STABILIZE": GAIN})
    assert command is not None
    np.testing.assert_array_equal(np.isnan(command[:, 0]), TIME_S >= 20.0)


def test_a_log_without_modes_tells_no_command() -> None:
    """Its set-points may answer anything."""
    assert _command_of(_segment()[0], [], {}) is None


def test_the_gains_are_those_of_the_autopilots_parameters() -> None:
    """By version, and none where the autopilot steers by position."""
    stabilize = {"ATC_ANG_RLL_P": 4.5, "ATC_ANG_PIT_P": 5.5, "ATC_ANG_YAW_P": 3.5}
    old = {"STB_RLL_P": 9.0, "STB_PIT_P": 8.0, "STB_YAW_P": 4.5}
    px4 = {"MC_ROLL_P": 6.5, "MC_PITCH_P": 6.0, "MC_YAW_P": 2.8}
    assert named("ardupilot").angle_gains("ALT_HOLD", stabilize) == (4.5, 5.5, 3.5)
    assert named("ardupilot").angle_gains("STABILIZE", old) == (9.0, 8.0, 4.5)
    assert named("ardupilot").angle_gains("LOITER", stabilize) is None
    assert named("px4").angle_gains("STABILIZED", px4) == (6.5, 6.0, 2.8)
    assert named("px4").angle_gains("ACRO", {}) == (0.0, 0.0, 0.0)
    assert named("px4").angle_gains("POSCTL", px4) is None
    assert named("betaflight").angle_gains("Acro", {}) == (0.0, 0.0, 0.0)
    assert named("betaflight").angle_gains("Angle", {}) is None


def test_a_gain_that_no_firmware_has_is_not_believed() -> None:
    """A damaged parameter would make numbers that overflow."""
    command = _command_of(_segment()[0], _modes((0.0, "STABILIZE")), {"STABILIZE": (1e300, np.inf, 4.0)})
    assert command is not None
    assert np.isnan(command[:, :2]).all()
    assert np.isfinite(command[:, 2]).all()


def test_sticks_that_ask_for_angles_are_the_command_of_roll_and_pitch() -> None:
    """Whatever the set-points answer; yaw's asks for a rate."""
    segment, _ = _segment()
    assert segment.reference is not None
    sticks = np.sin(np.outer(TIME_S, (2.0, 7.0)))
    (found,) = with_commands(
        [segment], _modes((0.0, "Angle")), {}, stick_gains={"Angle": (5.0, 4.0)}, sticks=[sticks]
    )
    assert found.command is not None
    np.testing.assert_allclose(found.command[:, :2], sticks * (5.0, 4.0))
    np.testing.assert_array_equal(found.command[:, 2], segment.reference[:, 2])


def test_sticks_count_only_in_modes_in_which_they_ask_for_angles() -> None:
    """In acro the set-points are the command."""
    segment, _ = _segment()
    assert segment.reference is not None
    (found,) = with_commands(
        [segment],
        _modes((0.0, "Angle"), (20.0, "Acro")),
        {"Acro": (0.0, 0.0, 0.0)},
        stick_gains={"Angle": (5.0, 5.0)},
        sticks=[np.zeros((TIME_S.size, 2))],
    )
    assert found.command is not None
    acro = TIME_S >= 20.0
    np.testing.assert_array_equal(found.command[acro], segment.reference[acro])
    np.testing.assert_array_equal(found.command[~acro, :2], 0.0)


def test_modes_of_several_kinds_are_told_apart() -> None:
    """Angles are held as stabilized as in altitude hold, and not in acro."""
    gains = {"STABILIZE": GAIN, "ALT_HOLD": GAIN, "ACRO": (0.0, 0.0, 0.0)}
    (found,) = with_commands(
        [_segment()[0]], _modes((0.0, "STABILIZE"), (15.0, "ACRO"), (25.0, "ALT_HOLD")), gains
    )
    assert found.law is not None
    acro = (TIME_S >= 15.0) & (TIME_S < 25.0)
    assert len(set(found.law[acro])) == len(set(found.law[~acro])) == 1
    assert found.law[0] != found.law[acro][0]


def test_modes_of_one_kind_are_one() -> None:
    """The gains are the same."""
    gains = {"STABILIZE": GAIN, "ALT_HOLD": GAIN}
    (found,) = with_commands([_segment()[0]], _modes((0.0, "STABILIZE"), (20.0, "ALT_HOLD")), gains)
    assert found.law is None
