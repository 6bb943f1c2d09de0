"""The mixer and the thrust curve, against the firmware's own steps and against their inverses."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from quadid_logs.autopilots.ardupilot.frames import frame_geometry, known_frames
from quadid_logs.autopilots.ardupilot.mixer import (
    Supply,
    actuator_of_pulse,
    actuator_of_thrust,
    compensation_gain,
    full_battery_thrust,
    mix,
    pulse_width,
)
from quadid_logs.maths.frames import normalised_allocation, torque_matrix
from tests.actuation.logs import MOTORS, supply


def factors_of(frame: tuple[int, int]) -> np.ndarray:
    """Return roll, pitch, yaw and throttle factors of a frame."""
    mixer = frame_geometry(*frame).mixer
    return np.column_stack([mixer, np.ones(len(mixer))])


def test_every_class_and_type_of_the_reference_is_known() -> None:
    """Quad, hexa, octa, octa-quad, Y6, dodeca-hexa and deca with the types that the firmware names."""
    wanted = {(1, kind) for kind in (0, 1, 2, 3, 4, 5, 6, 12, 13, 14, 18, 19)} | {
        (2, 0),
        (2, 1),
        (3, 0),
        (3, 1),
        (3, 2),
        (3, 3),
        (3, 15),
        (4, 1),
        (5, 10),
        (5, 11),
        (12, 0),
        (14, 0),
    }
    assert wanted <= set(known_frames())


@pytest.mark.parametrize("frame", known_frames())
def test_every_frame_returns_the_torque_that_was_mixed(frame: tuple[int, int]) -> None:
    """Torque to motors, through pulse widths, and back to torque: exact where nothing is limited."""
    rng = np.random.default_rng(3)
    command = rng.uniform(-0.08, 0.08, (50, 3))
    factors = factors_of(frame)
    # A frame without yaw factors (V-tail front motors) still has them on the others; none lacks an axis.
    given_supply = supply(50, voltage=0.9, density=0.92)
    output = mix(command, np.full(50, 0.45), factors, given_supply, MOTORS.yaw_headroom)
    assert not output.limited.any()
    actuator = actuator_of_thrust(output.thrust, given_supply, MOTORS)
    thrust = full_battery_thrust(actuator, given_supply, MOTORS) / given_supply.lift_max[:, None]
    found = thrust @ np.linalg.pinv(factors)[:3].T / given_supply.gain[:, None]
    np.testing.assert_allclose(found, command, atol=1e-12)


@pytest.mark.parametrize("frame", known_frames())
def test_px4_allocation_of_every_frame_returns_the_torque(frame: tuple[int, int]) -> None:
    """The set-point through the scaled pseudo-inverse and back."""
    airframe = frame_geometry(*frame)
    effectiveness = np.vstack(
        [torque_matrix(airframe.position, airframe.spin, 0.05), -np.ones(airframe.n_rotors)]
    )
    if np.linalg.matrix_rank(effectiveness) < 4:
        pytest.skip("this frame yaws by tilted motors, which upright rotors do not describe")
    allocation = normalised_allocation(effectiveness)
    setpoint = np.random.default_rng(4).uniform(-0.1, 0.1, (20, 3))
    thrust = np.column_stack([setpoint, np.full(20, 0.5)]) @ allocation.T
    found = thrust @ np.linalg.pinv(allocation)[:3].T
    np.testing.assert_allclose(found, setpoint, atol=2e-3 * np.abs(setpoint).max())


def firmware_mixer(
    command: np.ndarray, throttle: float, factors: np.ndarray, row: Supply, headroom: float
) -> np.ndarray:
    """Walk through `output_armed_stabilizing` motor by motor, for one row."""
    gain = float(row.gain[0])
    roll, pitch, yaw = (float(value) * gain for value in command)
    limit = float(row.throttle_limit[0]) * gain
    wanted = min(max(throttle * gain, 0.0), limit)
    average = min(max(float(row.throttle_average_max[0]) * gain, wanted), limit)
    best, room = min(0.5, average), 1.0
    out = []
    for roll_factor, pitch_factor, yaw_factor, _ in factors:
        each = roll * roll_factor + pitch * pitch_factor
        out.append(each)
        if yaw_factor:
            free = 1.0 - (best + each) if yaw * yaw_factor > 0.0 else best + each
            room = min(room, abs(max(free, 0.0) / yaw_factor))
    room = max(room, headroom)
    yaw = min(max(yaw, -room), room)
    out = [each + yaw * factor[2] for each, factor in zip(out, factors, strict=True)]
    low, high = min(out), max(out)
    scale = 1.0 / (high - low) if high - low > 1.0 else 1.0
    if average + low < 0.0:
        scale = min(scale, -average / low)
    low, high = low * scale, high * scale
    adjust = wanted + low
    if scale < 1.0 or adjust < 0.0:
        adjust = 0.0
    elif adjust > 1.0 - (high - low):
        adjust = 1.0 - (high - low)
    return np.array([-low + adjust + scale * each for each in out])


@settings(max_examples=150, deadline=None)
@given(
    st.sampled_from(known_frames()),
    st.tuples(*[st.floats(-1.5, 1.5)] * 3),
    st.floats(0.0, 1.0),
    st.floats(0.1, 1.0),
    st.floats(0.7, 1.0),
)
def test_the_mixer_does_what_the_firmware_does_at_every_limit(
    frame: tuple[int, int], command: tuple[float, float, float], throttle: float, average: float, volt: float
) -> None:
    """Any command, far into saturation, gives the thrusts of the step-by-step port."""
    factors = factors_of(frame)
    row = supply(1, voltage=volt, average_max=average)
    given_command = np.array(command)
    ours = mix(given_command[None, :], np.array([throttle]), factors, row, MOTORS.yaw_headroom).thrust[0]
    np.testing.assert_allclose(ours, firmware_mixer(given_command, throttle, factors, row, 0.2), atol=1e-9)


def test_a_limited_axis_is_marked_and_the_others_are_not() -> None:
    """Too much yaw is clipped; roll and pitch are given in full."""
    output = mix(
        np.array([[0.1, 0.0, 0.9]]), np.array([0.3]), factors_of((1, 1)), supply(1, average_max=0.3), 0.2
    )
    assert output.limited.tolist() == [[False, False, True]]


@given(st.floats(0.0, 1.0), st.floats(0.6, 1.0))
def test_thrust_survives_the_way_through_the_pulse_width(thrust: float, voltage: float) -> None:
    """Forth and back the error is that of a microsecond."""
    row = supply(1, voltage=voltage)
    actuator = actuator_of_thrust(np.array([[thrust]]), row, MOTORS)
    again = actuator_of_pulse(pulse_width(actuator, MOTORS), MOTORS)
    assert abs(float(again[0, 0] - actuator[0, 0])) <= 0.5001 / 800.0


def test_thin_air_and_a_weak_battery_raise_the_gain() -> None:
    """One over lift_max and over the density ratio, as far as the firmware believes them."""
    gain = compensation_gain(np.array([0.5, 1.0, 1.0, 0.0]), np.array([1.0, 0.8, 0.1, 1.0]))
    np.testing.assert_allclose(gain, [2.0, 1.25, 1.0, 1.0])


def test_no_expo_means_a_straight_line() -> None:
    """MOT_THST_EXPO 0 is a case of its own in the firmware."""
    from dataclasses import replace

    straight = replace(MOTORS, expo=0.0)
    row = supply(1)
    assert actuator_of_thrust(np.array([[0.3]]), row, straight)[0, 0] == pytest.approx(0.3)


def test_the_gain_against_thin_air_is_limited_as_the_density_that_is_believed() -> None:
    """Ratios of 0.3 to 1.5 are believed and limited to 0.5 to 1.25; others count as sea level."""
    density = np.array([0.25, 0.35, 0.5, 1.25, 1.45, 1.6])
    np.testing.assert_allclose(compensation_gain(np.ones(6), density), [1.0, 2.0, 2.0, 0.8, 0.8, 1.0])
