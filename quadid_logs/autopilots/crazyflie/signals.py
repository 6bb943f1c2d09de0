"""The table of a Crazyflie's log variables.

Source: the firmware of 2026 (``stabilizer.c``, ``controller_pid.c``, ``controller_mellinger.c``,
``controller_indi.c``, ``controller_lee.c``, ``power_distribution_quadrotor.c``, ``quatcompress.h``,
``motors.c``, ``pm_stm32f4.c``, ``supervisor.c``). Body axes of sensors and of the Lee controller are x
forward, y left, z up, against an Earth frame whose z is up. Euler angles, rate set-points and rates of the
older groups have the pitch of the first Crazyflie, positive with the nose up, and yaw positive to the left.
The older controllers' commands go to the motors by the mixer alone, which fixes their signs: positive is
right side down, nose up, nose right.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Final

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.autopilots.sources import RPM, Part, Source, attitude_columns, plain
from quadid_logs.containers.usd import EventTable
from quadid_logs.data.log import GyroFilter
from quadid_logs.vocabulary import GRAVITY_M_S2

EventPart = Part[EventTable]
_Build = Callable[[EventPart, Source[Any]], FloatArray | None]

#: GYRO_LPF_CUTOFF_FREQ of the sensors' drivers: a low-pass of second order at 1 kHz.
GYRO_FILTER: Final = GyroFilter(low_pass_hz=80.0)
_DEGREE: Final = math.pi / 180.0
#: Commands and duty cycles are counts of 16 bits.
_FULL: Final = 65535.0
_FORWARD_LEFT_UP: Final = np.array([1.0, -1.0, -1.0])
_YAW_LEFT: Final = np.array([1.0, 1.0, -1.0])
#: A step of 1 mm/s, as the log holds it, is 0.02 rad/s behind this smoothing, where a flown trajectory has
#: ten times that; what it leaves of 5 Hz is two thirds [s].
_REFERENCE_SIGMA_S: Final = 0.03
_LEAST_PERIOD_S, _PAUSE_PERIODS = 1e-4, 3.0
#: Of ``supervisor.info``.
_IS_ARMED, _IS_FLYING = 1, 4
#: Duties of the motors front right, back right, back left, front left by roll, pitch and yaw command: the
#: mixer halves roll and pitch, and this takes it back.
_UNMIXED: Final = np.array(
    [[-0.5, -0.5, 0.5, 0.5], [0.5, -0.5, -0.5, 0.5], [0.25, -0.25, 0.25, -0.25]]
)  # fmt: skip


def _signed(sign: FloatArray) -> _Build:
    """Return a builder that turns axes."""

    def build(part: EventPart, source: Source[Any]) -> FloatArray | None:
        values = plain(part, source)
        return None if values is None else values * sign

    return build


_flu, _yaw_left = _signed(_FORWARD_LEFT_UP), _signed(_YAW_LEFT)


def _flown(build: _Build) -> _Build:
    """Return a builder of what a controller commanded, of which None never ran: its variables do not move."""

    def moving(part: EventPart, source: Source[Any]) -> FloatArray | None:
        values = build(part, source)
        return None if values is None or not np.any(values != values[:1]) else values

    return moving


_command, _command_flu, _command_yaw_left = _flown(plain), _flown(_flu), _flown(_yaw_left)


def _unmixed(part: EventPart, source: Source[Any]) -> FloatArray | None:
    """Turn the motors' duties into the command of which the mixer makes them."""
    duty = plain(part, source)
    return None if duty is None else np.asarray(duty @ _UNMIXED.T)


def _frd(quaternion: FloatArray) -> FloatArray:
    """Return Euler angles, FRD against NED, of quaternions w, x, y, z of x forward, y left, z up."""
    return attitude_columns(quaternion * np.array([1.0, 1.0, -1.0, -1.0]))


def _reference_rates(part: EventPart, source: Source[Any]) -> FloatArray | None:
    """Make the rates with which a vehicle tilts that follows a trajectory, of its velocity over the ground.

    It tilts by acceleration over gravity, so that its rates are the jerk over gravity: the second derivative
    of the velocity, smoothed as the sigma says. The nose is taken to point along x, as it does unless yaw is
    commanded. Near a pause of the log the rates are nothing.
    """
    velocity = _command(part, source)
    step_s = np.diff(part.rows.time_s)
    period_s = float(np.median(step_s)) if len(step_s) else 0.0
    if velocity is None or not _LEAST_PERIOD_S <= period_s <= _REFERENCE_SIGMA_S:
        return None
    reach = math.ceil(4.0 * _REFERENCE_SIGMA_S / period_s)
    x = np.arange(-reach, reach + 1) * period_s / _REFERENCE_SIGMA_S
    kernel = np.exp(-0.5 * x**2)
    kernel = (x**2 - 1.0) * kernel / (kernel.sum() * _REFERENCE_SIGMA_S**2)
    kernel -= kernel.mean()
    pause = (step_s > _PAUSE_PERIODS * period_s) | (step_s < 0.0)
    jerk = np.zeros((len(velocity), 3))
    for axis in (0, 1):
        padded = np.pad(np.nan_to_num(velocity[:, axis]), reach, mode="edge")
        jerk[:, axis] = np.convolve(padded, kernel, mode="valid")
    near = np.convolve(np.pad(np.append(pause, False), reach), np.ones(2 * reach + 1), mode="valid") > 0.5
    jerk[near] = 0.0
    forward, left, _ = jerk.T
    return np.column_stack([-left, -forward, np.zeros(len(jerk))]) / GRAVITY_M_S2


def _attitude(part: EventPart, source: Source[Any]) -> FloatArray | None:
    quaternion = plain(part, source)
    return None if quaternion is None else _frd(quaternion)


def _compressed(part: EventPart, source: Source[Any]) -> FloatArray | None:
    """Unpack quaternions of 32 bits: which component is largest, sign and 9 bits of each other one."""
    packed = part.table.column(source.fields[0])
    if packed is None or packed.dtype.kind not in "iu":
        return None
    bits = packed.astype(np.int64)
    largest = bits >> 30 & 3
    quaternion = np.zeros((len(bits), 4))
    # In the order x, y, z, w, the last one in the lowest bits.
    for component in (3, 2, 1, 0):
        here = largest != component
        value = math.sqrt(0.5) * (bits & 511) / 511.0 * np.where(bits >> 9 & 1, -1.0, 1.0)
        quaternion[here, component] = value[here]
        bits = np.where(here, bits >> 10, bits)
    rest = np.sqrt(np.maximum(1.0 - np.sum(quaternion**2, axis=1), 0.0))
    np.put_along_axis(quaternion, largest[:, np.newaxis], rest[:, np.newaxis], axis=1)
    return _frd(quaternion[:, [3, 0, 1, 2]])


def _bit(number: int) -> _Build:
    """Return a builder that takes one bit."""

    def build(part: EventPart, source: Source[Any]) -> FloatArray | None:
        column = part.table.column(source.fields[0])
        if column is None or column.dtype.kind not in "iu":
            return None
        return (column.astype(np.int64) >> number & 1).astype(np.float64)[:, np.newaxis]

    return build


def _is_not(build: _Build) -> _Build:
    """Return a builder of the opposite."""

    def opposite(part: EventPart, source: Source[Any]) -> FloatArray | None:
        values = build(part, source)
        return None if values is None else (values == 0.0).astype(np.float64)

    return opposite


def _of(group: str, names: str) -> tuple[str, ...]:
    return tuple(f"{group}.{name}" for name in names.split())


_TRAJECTORY: Final = "the velocity of the reference trajectory, which does not depend on the vehicle's motion"
_OWN = "input of the {} controller"
_OUT = "the {} controller's output, counts of 65535"
_LEE_TORQUE: Final = (
    "the Lee controller's output, in newton metres of the motors and propellers that the firmware assumes"
)
_THRUST: Final = (
    "the Lee controller's output, in newtons of the motors and propellers that the firmware assumes"
)
#: Which event holds a variable is its owner's choice: a source is looked for in every one.
ANY_EVENT: Final = "event"
SOURCES: Final[tuple[Source[EventPart], ...]] = (
    Source("body_rate", ANY_EVENT, _of("ctrlLee", "omegax omegay omegaz"), _OWN.format("Lee"), _command_flu,
           filtered=True),
    Source("body_rate", ANY_EVENT, _of("controller", "r_roll r_pitch r_yaw"), _OWN.format("PID"),
           _command_yaw_left, filtered=True),
    Source("body_rate", ANY_EVENT, _of("ctrlMel", "r_roll r_pitch r_yaw"), _OWN.format("Mellinger"),
           _command_yaw_left, filtered=True),
    Source("body_rate", ANY_EVENT, _of("gyro", "x y z"), "the filtered gyro", _flu, _DEGREE,
           filtered=True),
    Source("body_rate", ANY_EVENT, _of("stateEstimateZ", "rateRoll ratePitch rateYaw"),
           "the filtered gyro, in whole mrad/s", _yaw_left, 1e-3, filtered=True),
    Source("body_rate_setpoint", ANY_EVENT, _of("ctrlLee", "omegarx omegary omegarz"),
           "the Lee controller's own rate set-point", _command_flu),
    Source("body_rate_setpoint", ANY_EVENT, _of("controller", "rollRate pitchRate yawRate"),
           "the rate controller's set-point", _command_yaw_left, _DEGREE),
    Source("reference_rate", ANY_EVENT, _of("ctrltarget", "vx vy"), _TRAJECTORY, _reference_rates),
    Source("reference_rate", ANY_EVENT, _of("ctrltargetZ", "vx vy"), _TRAJECTORY, _reference_rates, 1e-3),
    Source("attitude", ANY_EVENT, _of("ctrlLee", "rpyx rpyy rpyz"), _OWN.format("Lee"), _command_flu),
    Source("attitude", ANY_EVENT, _of("stateEstimate", "qw qx qy qz"), "the estimator's attitude", _attitude),
    Source("attitude", ANY_EVENT, _of("stateEstimateZ", "quat"),
           "the estimator's attitude, packed in 32 bits",
           _compressed),
    Source("attitude", ANY_EVENT, _of("stabilizer", "roll pitch yaw"), "the estimator's attitude",
           _yaw_left, _DEGREE),
    Source("attitude", ANY_EVENT, _of("stateEstimate", "roll pitch yaw"), "the estimator's attitude",
           _yaw_left, _DEGREE),
    Source("velocity", ANY_EVENT, _of("stateEstimate", "vx vy vz"), "the estimator's velocity", _flu),
    Source("velocity", ANY_EVENT, _of("stateEstimateZ", "vx vy vz"), "the estimator's velocity, in mm/s",
           _flu, 1e-3),
    Source("torque_command", ANY_EVENT, _of("ctrlLee", "torquex torquey torquez"), _LEE_TORQUE,
           _command_flu, normalised=False),
    Source("torque_command", ANY_EVENT, _of("controller", "cmd_roll cmd_pitch cmd_yaw"), _OUT.format("PID"),
           _command, 1.0 / _FULL),
    Source("torque_command", ANY_EVENT, _of("ctrlMel", "cmd_roll cmd_pitch cmd_yaw"),
           _OUT.format("Mellinger"), _command, 1.0 / _FULL),
    Source("torque_command", ANY_EVENT, _of("ctrlINDI", "cmd_roll cmd_pitch cmd_yaw"), _OUT.format("INDI"),
           _command, 1.0 / _FULL),
    Source("torque_command", ANY_EVENT, _of("motor", "m1 m2 m3 m4"),
           "the motors' duty cycles back through the mixer, counts of 65535, with saturation", _unmixed,
           1.0 / _FULL),
    Source("thrust_n", ANY_EVENT, _of("ctrlLee", "thrustSi"), _THRUST, _command),
    Source("thrust_n", ANY_EVENT, _of("ctrlLee", "thrustSI"), _THRUST, _command),
    Source("throttle", ANY_EVENT, _of("controller", "cmd_thrust"), _OUT.format("PID"), _command, 1.0 / _FULL),
    Source("throttle", ANY_EVENT, _of("ctrlMel", "cmd_thrust"), _OUT.format("Mellinger"), _command,
           1.0 / _FULL),
    Source("throttle", ANY_EVENT, _of("ctrlINDI", "cmd_thrust"), _OUT.format("INDI"), _command, 1.0 / _FULL),
    Source("throttle", ANY_EVENT, _of("stabilizer", "thrust"), "collective command, counts of 65535",
           _command, 1.0 / _FULL),
    Source("rotor_speed", ANY_EVENT, _of("rpm", "m1 m2 m3 m4"), "speeds by the RPM deck", scale=RPM),
    Source("rotor_speed", ANY_EVENT, _of("motor", "m1_rpm m2_rpm m3_rpm m4_rpm"),
           "speeds by the motors' controllers", scale=RPM),
    Source("specific_force", ANY_EVENT, _of("acc", "x y z"), "the filtered accelerometer", _flu,
           GRAVITY_M_S2),
    Source("battery_voltage", ANY_EVENT, _of("pm", "vbat"), "voltage of the battery"),
    Source("battery_voltage", ANY_EVENT, _of("pm", "vbatMV"), "voltage of the battery in mV", scale=1e-3),
    Source("armed", ANY_EVENT, _of("supervisor", "info"), "the supervisor's state", _bit(_IS_ARMED)),
    Source("landed", ANY_EVENT, _of("supervisor", "info"), "the supervisor's state",
           _is_not(_bit(_IS_FLYING))),
    Source("landed", ANY_EVENT, _of("sys", "isFlying"), "the firmware's own flag for flying",
           _is_not(plain)),
)  # fmt: skip
