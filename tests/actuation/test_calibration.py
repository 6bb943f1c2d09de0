"""Steps on the way to newton metres, each by itself, against closed forms."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from quadid_logs.actuation.airframe import Airframe, with_rotors
from quadid_logs.actuation.calibration import Scaled, _Hover, _position, _rotor_force, _thrust, torque_n_m
from quadid_logs.actuation.motors import MotorSeries
from quadid_logs.actuation.rotor_speed import from_rotor_speed
from quadid_logs.align import clean
from quadid_logs.align.series import CleanLog
from quadid_logs.autopilots.ardupilot.frames import frame_geometry
from quadid_logs.data.torque import Calibration
from quadid_logs.data.vehicle import Rotor, Vehicle
from tests.align.flights import flight_log, signal

GRAVITY = 9.80665
STAMPS = np.arange(10.0, 40.0, 0.01)
#: An H: long arms in front, short ones behind.
FRAME = Airframe(
    name="h",
    source="test",
    factors=np.zeros((4, 4)),
    position=np.array([[1.0, 0.6, 0.0], [-0.5, -0.6, 0.0], [1.0, -0.6, 0.0], [-0.5, 0.6, 0.0]]),
    spin=np.array([1.0, 1.0, -1.0, -1.0]),
    max_thrust_n=10.0,
    thrust_source="CA_ROTORn_CT",
)


def to_ned(phi: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """Return what turns body axes into Earth's, for a vehicle that heads north; (n, 3, 3)."""
    zero, one = np.zeros_like(phi), np.ones_like(phi)
    pitch = np.array(
        [[np.cos(theta), zero, np.sin(theta)], [zero, one, zero], [-np.sin(theta), zero, np.cos(theta)]]
    )
    roll = np.array([[one, zero, zero], [zero, np.cos(phi), -np.sin(phi)], [zero, np.sin(phi), np.cos(phi)]])
    return np.einsum("ijn,jkn->nik", pitch, roll)


ANGLES = np.column_stack([0.7 * np.sin(1.3 * STAMPS), 0.8 * np.cos(0.9 * STAMPS), np.zeros(STAMPS.size)])


def test_the_force_of_the_rotors_is_found_under_any_push_of_the_air() -> None:
    """Tilted by up to 45 degrees to all sides, pushed horizontally by up to half of the weight."""
    force = 10.0 + 2.0 * np.sin(STAMPS)
    push = np.column_stack([4.0 * np.sin(0.7 * STAMPS), 5.0 * np.cos(1.1 * STAMPS), np.zeros(STAMPS.size)])
    felt = np.einsum("nij,ni->nj", to_ned(ANGLES[:, 0], ANGLES[:, 1]), push) - np.outer(
        force, [0.0, 0.0, 1.0]
    )
    log = clean(
        flight_log(signal("specific_force", STAMPS, felt), signal("attitude", STAMPS, ANGLES, start=3))
    )
    found = _rotor_force(log)
    assert found is not None
    np.testing.assert_allclose(found.force, force, rtol=1e-9)


def test_without_an_accelerometer_a_tilted_vehicle_needs_more_than_its_weight() -> None:
    """Its thrust over mass is gravity over the cosine of the tilt."""
    found = _rotor_force(clean(flight_log(signal("attitude", STAMPS, ANGLES))))
    assert found is not None
    upright = to_ned(ANGLES[:, 0], ANGLES[:, 1])[:, 2, 2]
    np.testing.assert_allclose(found.force, np.where(upright > 0.5, GRAVITY / upright, 0.0))


def test_the_arm_that_is_given_is_the_longest_one() -> None:
    """The others keep their proportion."""
    found = _position(FRAME, Vehicle(arm_length_m=0.35))
    assert found is not None
    np.testing.assert_allclose(found, 0.35 / math.hypot(1.0, 0.6) * FRAME.position)


def test_rotors_of_the_vehicle_file_turn_as_they_say() -> None:
    """Counter-clockwise from above drags the vehicle clockwise: N is positive."""
    spins = ("cw", "cw", "ccw", "ccw")
    rotors = tuple(
        Rotor(position_m=tuple(row), spin=spin) for row, spin in zip(FRAME.position, spins, strict=True)
    )  # type: ignore[arg-type]
    found = with_rotors(FRAME, Vehicle(rotors=rotors))
    assert isinstance(found, Airframe)
    np.testing.assert_array_equal(found.spin, [-1.0, -1.0, 1.0, 1.0])


@pytest.mark.parametrize(("newton", "n_refused"), [(7.5, 1), (8.5, 0), (10.0, 0), (12.0, 0), (13.0, 1)])
def test_a_parameter_is_refused_that_the_weight_contradicts(newton: float, n_refused: int) -> None:
    """10 N by the parameter: the hover may need a fifth less to a quarter more."""
    hover = _Hover(newton=newton, sigma=0.02, voltage_exponent=0.0, voltage=None, mean_voltage=math.nan)
    assert len(_thrust(FRAME, Vehicle(mass_kg=2.0), hover).refused) == n_refused


def motors(thrust: np.ndarray, actuator: np.ndarray) -> MotorSeries:
    """Return what four motors did at `STAMPS`, all of it in the air."""
    base = clean(flight_log(signal("torque_command", STAMPS, thrust[:, :3]))).candidates["torque_command"][0]
    return MotorSeries(
        base=base,
        thrust=thrust,
        command_thrust=thrust,
        actuator=actuator,
        command=thrust[:, :3],
        saturated=None,
        flown=np.ones(STAMPS.size, dtype=bool),
        source="test",
        reason="",
        achieved=True,
    )


THRUST = 0.4 + 0.3 * np.sin(STAMPS[:, np.newaxis] * [1.3, 1.7, 2.1, 2.9])


def in_newton_metres(airframe: Airframe, series: MotorSeries) -> np.ndarray:
    scaled = Scaled(
        calibration=Calibration(torque_to_thrust_m=0.02),
        thrust_of=lambda one: 10.0 * one.thrust,
        position=FRAME.position,
        remarks=(),
        refused=(),
        needs=(),
    )
    found = torque_n_m(series, airframe, scaled)
    assert found is not None
    return found.series.values


def test_torque_is_the_cross_product_of_places_and_thrusts_and_the_drag_of_the_rotors() -> None:
    """Worked out by numpy's cross product; the drag turns against the rotor."""
    force = np.zeros((STAMPS.size, 4, 3))
    force[:, :, 2] = -10.0 * THRUST
    expected = np.cross(FRAME.position, force).sum(axis=1)
    expected[:, 2] = 0.02 * 10.0 * THRUST @ FRAME.spin
    np.testing.assert_allclose(in_newton_metres(FRAME, motors(THRUST, np.sqrt(THRUST))), expected, atol=1e-12)


def test_in_the_simulator_yaw_goes_with_thrust_times_motor_command() -> None:
    """SIM_Motor.cpp; roll and pitch stay as they are."""
    series = motors(THRUST, np.sqrt(THRUST))
    found = in_newton_metres(replace(FRAME, yaw_with_command=True), series)
    np.testing.assert_allclose(found[:, 2], 0.02 * 10.0 * THRUST**1.5 @ FRAME.spin)
    np.testing.assert_array_equal(found[:, :2], in_newton_metres(FRAME, series)[:, :2])


def telemetry(age_s: float) -> CleanLog:
    """Return a log with rotor speeds that show what the motors did some time ago, with noise of 1 %."""
    then = 0.4 + 0.35 * np.sin((STAMPS[:, np.newaxis] - age_s) * [5.3, 6.1, 7.3, 8.9])
    noise = 8.0 * np.random.default_rng(3).standard_normal(then.shape)
    throttle = signal("throttle", STAMPS, np.full((STAMPS.size, 1), 0.4), start=3)
    return clean(flight_log(signal("rotor_speed", STAMPS, 900.0 * np.sqrt(then) + noise), throttle))


@pytest.mark.parametrize("age_s", [0.0, 0.04, 0.08])
def test_rotor_speeds_give_the_thrust_that_the_commands_gave_when_they_were_measured(age_s: float) -> None:
    """Square of speed, scaled to the commanded thrust in the mean; up to 80 ms older than its stamp."""
    now = 0.4 + 0.35 * np.sin(STAMPS[:, np.newaxis] * [5.3, 6.1, 7.3, 8.9])
    airframe = replace(FRAME, factors=np.column_stack([np.eye(4)[:, :3] + 0.1, np.ones(4)]))
    found = from_rotor_speed(telemetry(age_s), airframe, motors(now, np.sqrt(now)))
    assert "follows the commanded thrust (correlation 0.99" in found.verdict
    assert found.series is not None
    then = 0.4 + 0.35 * np.sin((STAMPS[:, np.newaxis] - age_s) * [5.3, 6.1, 7.3, 8.9])
    assert found.series.thrust.mean() == pytest.approx(then.mean(), rel=0.01)


def test_in_the_simulator_a_small_yaw_command_is_as_strong_as_it_says() -> None:
    """At the mean thrust, where each rotor's command rises with the root of its thrust."""
    yaw = 0.002 * np.sin(STAMPS * 5.0)[:, np.newaxis]
    airframe = replace(FRAME, factors=np.column_stack([frame_geometry(1, 1).mixer, np.ones(4)]))
    thrust = 0.4 + 0.1 * np.sin(1.3 * STAMPS)[:, np.newaxis] + yaw * airframe.factors[:, 2]
    command = np.column_stack([np.zeros((STAMPS.size, 2)), yaw])
    series = replace(motors(thrust, np.sqrt(thrust)), command=command)
    found = series.as_command(replace(airframe, yaw_with_command=True)).series.values[:, 2]
    middle = np.abs(thrust.mean(axis=1) - 0.4) < 0.02
    slope = float(found[middle] @ yaw[middle, 0] / (yaw[middle, 0] @ yaw[middle, 0]))
    assert slope == pytest.approx(1.0, abs=0.02)
    high = thrust.mean(axis=1) > 0.48
    assert float(found[high] @ yaw[high, 0] / (yaw[high, 0] @ yaw[high, 0])) == pytest.approx(
        np.sqrt(0.49 / 0.4), abs=0.02
    )
