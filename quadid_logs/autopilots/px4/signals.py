"""PX4's topics in canonical signals: one table, the preferred source of each signal first.

Field meanings: PX4-Autopilot/msg/*.msg of the versions 1.6 to 1.17. PX4 works in
FRD and NED like we do; only thrust points the other way.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final, TypeAlias

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.autopilots.px4.fifo import FIELDS, gyro_fifo
from quadid_logs.autopilots.sources import (
    RPM,
    Built,
    Part,
    Source,
    attitude,
    build_signals,
    plain,
    stacked,
    used_columns,
)
from quadid_logs.containers.ulog import TopicKey, TopicTable
from quadid_logs.data.log import ControllerTerms, GyroFilter, Rows, Signal
from quadid_logs.vocabulary import AXES

_MAX_SAMPLE_AGE_US: Final = 100_000
"""A sample is published within milliseconds: a `timestamp_sample` further off is not filled in."""

#: Output drivers of a vehicle; more different numbers are damage.
_MOST_DRIVERS: Final = 4

_Part: TypeAlias = Part[TopicTable]
_Row: TypeAlias = Source[Any]


def _motors(part: _Part, source: _Row) -> FloatArray | None:
    """Thrust per motor up to the last motor in use; NaN means stopped and stays NaN."""
    control = plain(part, source)
    return None if control is None else used_columns(control, np.isfinite(control))


def _outputs(part: _Part, source: _Row) -> Built | None:
    """Pulse widths up to the last channel in use; None where the outputs are no pulse widths.

    Up to 1.12 two drivers could write into one instance. Each gives the number of its own outputs
    (`MixingOutput::setAndPublishActuatorOutputs`), or none at all.
    """
    output, counts = plain(part, source), part.table.column("noutputs")
    rows, note = part.rows, ""
    if output is not None and counts is not None and counts.ndim == 1:
        drivers = [counts == count for count in np.unique(counts)]
        if 1 < len(drivers) <= _MOST_DRIVERS:
            # The motors are on the one that moves most.
            movement = [_movement(output[one]) for one in drivers]
            mine = drivers[int(np.argmax(movement))]
            output, rows = output[mine], Rows(rows.time_s[mine], rows.position[mine])
            note = f"rows with {counts[mine][0]} in noutputs: another driver wrote the other rows"
    used = None if output is None else used_columns(output, output > 0.0)
    if used is None:
        return None
    pulse = (used >= 800.0) & (used <= 2200.0)
    # CAN escs and simulators use 0..8191 or -1..1 in the same field.
    return Built(used, note, rows=rows) if pulse.any() and not (used > 2200.0).any() else None


def _rotor_speed(part: _Part, source: _Row) -> FloatArray | None:
    """Speed per ESC; None where it never moves, as with ESCs that do not measure it."""
    escs = part.table.column("esc")
    if escs is None or "esc_rpm" not in (escs.dtype.names or ()):
        return None
    rpm = np.abs(escs["esc_rpm"].astype(np.float64)).reshape(len(escs), -1)
    used = used_columns(rpm, rpm > 0.0)
    return None if used is None or not np.ptp(used, axis=0).any() else used * source.scale


def _armed(part: _Part, source: _Row) -> FloatArray | None:
    """ARMING_STATE_ARMED is 2 in every version."""
    state = plain(part, source)
    return None if state is None else (state == 2.0).astype(np.float64)


def _injected_rate(part: _Part, source: _Row) -> FloatArray | None:
    """Sum the axes: the autotune moves one at a time."""
    rates = plain(part, source)
    return None if rates is None else np.nan_to_num(rates).sum(axis=1, keepdims=True)


_XYZ: Final = ("xyz",)
_QUATERNION: Final = ("q[0]", "q[1]", "q[2]", "q[3]")
INTEGRATORS: Final = "rate_ctrl_status"
#: By topic and term the field of each axis; the last is the rate about the vertical that the attitude's
#: set-point asks for.
_TERMS: Final = (
    ("vehicle_angular_velocity", "derivative", {axis: f"xyz_derivative[{n}]" for n, axis in enumerate(AXES)}),
    (INTEGRATORS, "I", {axis: f"{axis}speed_integ" for axis in AXES}),
    ("vehicle_attitude_setpoint", "rate_forward", {"yaw": "yaw_sp_move_rate"}),
)
_TORQUE: Final = ("control[0]", "control[1]", "control[2]")

SOURCES: Final[tuple[Source[_Part], ...]] = (
    Source("body_rate", "vehicle_angular_velocity", _XYZ,
           "the rate controller's own input: calibrated, bias removed, filtered (IMU_GYRO_CUTOFF)",
           filtered=True),
    Source("body_rate", "vehicle_attitude", ("rollspeed", "pitchspeed", "yawspeed"),
           "the estimator's bias-corrected rates (PX4 up to 1.9)"),
    Source("body_rate", "sensor_combined", ("gyro_rad",),
           "the gyro's mean over its integration time, bias not removed", raw=True),
    Source("body_rate_setpoint", "vehicle_rates_setpoint", ("roll", "pitch", "yaw"),
           "the rate controller's set-point"),
    Source("sysid_chirp", "autotune_attitude_control_status", ("rate_sp",),
           "rate that the autotune adds to the set-point of one axis after the other", _injected_rate),
    Source("attitude", "vehicle_attitude", _QUATERNION, "the estimator's attitude", attitude, label="q"),
    Source("velocity", "vehicle_local_position", ("vx", "vy", "vz"), "the estimator's velocity"),
    Source("attitude_setpoint", "vehicle_attitude_setpoint", ("roll_body", "pitch_body", "yaw_body"),
           "the attitude controller's set-point (PX4 up to 1.14)"),
    Source("attitude_setpoint", "vehicle_attitude_setpoint", tuple(f"q_d[{n}]" for n in range(4)),
           "the attitude controller's set-point", attitude, label="q_d"),
    Source("torque_command", "vehicle_torque_setpoint", _XYZ,
           "the rate controller's output before allocation"),
    Source("torque_command", "actuator_controls_0", _TORQUE,
           "the rate controller's output before the mixer (PX4 up to 1.13)", label="control[0..2]"),
    Source("throttle", "vehicle_thrust_setpoint", ("xyz[2]",), "collective thrust before allocation",
           scale=-1.0, label="-xyz[2]"),
    Source("throttle", "actuator_controls_0", ("control[3]",),
           "collective thrust before the mixer (PX4 up to 1.13)"),
    Source("throttle", "vehicle_rates_setpoint", ("thrust_body[2]",),
           "thrust set-point of the rate controller", scale=-1.0, label="-thrust_body[2]"),
    Source("motor_thrust", "actuator_motors", ("control",),
           "allocated thrust per motor before THR_MDL_FAC, which includes saturation", _motors),
    Source("output_pwm", "actuator_outputs", ("output",), "the outputs that the driver sent", _outputs),
    Source("rotor_speed", "esc_status", ("esc",), "reported by the ESCs", _rotor_speed, RPM, "esc[].esc_rpm"),
    Source("unallocated_torque", "control_allocator_status", ("unallocated_torque",),
           "torque that the control allocation could not achieve"),
    Source("specific_force", "sensor_combined", ("accelerometer_m_s2",),
           "the accelerometer's mean over its integration time"),
    Source("specific_force", "vehicle_acceleration", _XYZ, "bias removed, filtered"),
    Source("vibration_level", "vehicle_imu_status", ("accel_vibration_metric",),
           "of one sensor, at its own rate"),
    Source("accelerometer_clips", "vehicle_imu_status", tuple(f"accel_clipping[{n}]" for n in range(3)),
           "of one sensor, by axis"),
    Source("gyro_samples", "sensor_gyro_fifo", FIELDS, "every sample of the gyro, before its filters",
           gyro_fifo, raw=True),
    Source("battery_voltage", "battery_status", ("voltage_v",), "measured"),
    Source("armed", "vehicle_status", ("arming_state",), "the commander's arming state", _armed,
           label="arming_state == 2"),
    Source("armed", "actuator_armed", ("armed",), "the state that the output drivers follow"),
    Source("landed", "vehicle_land_detected", ("landed",), "the land detector"),
)  # fmt: skip


def signals(topics: Mapping[TopicKey, TopicTable], known: GyroFilter) -> dict[str, tuple[Signal, ...]]:
    """Make the signals of a log.

    Parameters
    ----------
    known : GyroFilter
        What the parameters tell of the gyro's filters.
    """
    parts: dict[str, list[_Part]] = {}
    for (name, instance), table in topics.items():
        time_s = sample_time_s(table)
        if time_s is not None:
            shown = f"{name}[{instance}]" if instance else name
            parts.setdefault(name, []).append(
                Part(name=shown, table=table, rows=Rows(time_s, table.position))
            )
    found = build_signals(
        SOURCES, lambda source: parts.get(source.message, []), separator=", ", gyro_filter=known
    )
    if "output_pwm" in found:
        # Several drivers publish outputs; the motors are on the one that moves most.
        found["output_pwm"] = tuple(
            sorted(found["output_pwm"], key=lambda one: _movement(one.values), reverse=True)
        )
    return found


def controller_terms(topics: Mapping[TopicKey, TopicTable]) -> tuple[ControllerTerms, ...]:
    """Return the angular acceleration that D acts on, the integrators, and what is fed forward to yaw."""
    found = []
    for topic, term, fields in _TERMS:
        table = topics.get((topic, 0))
        time_s = None if table is None else sample_time_s(table)
        if table is None or time_s is None:
            continue
        rows = Rows(time_s, table.position)
        for axis, field in fields.items():
            values = stacked(table, (field,))
            if values is not None and values.shape[1] == 1:
                found.append(ControllerTerms(axis=axis, rows=rows, values={term: values[:, 0]}))
    return tuple(found)


def sample_time_s(table: TopicTable) -> FloatArray | None:
    """Return when each row was sampled [s]; None where the topic has no time.

    `timestamp_sample` where it is filled in (not zero, at most 0.1 s from
    `timestamp`), else `timestamp`, the time of publication.

    Returns
    -------
    ndarray, shape (n_rows,), or None
    """
    if not table.has("timestamp", "u"):
        return None
    published = table.rows["timestamp"].astype(np.float64)
    if not table.has("timestamp_sample", "u"):
        return published / 1e6
    sampled = table.rows["timestamp_sample"].astype(np.float64)
    plausible = (sampled > 0.0) & (np.abs(published - sampled) <= _MAX_SAMPLE_AGE_US)
    return np.where(plausible, sampled, published) / 1e6


def _movement(values: FloatArray) -> float:
    """Return how much a driver's outputs move in all, in their own unit; 0 where damaged numbers hide it."""
    movement = float(np.std(values, axis=0).sum())
    return movement if np.isfinite(movement) else 0.0
