"""ULog as PX4 main writes it.

Source: docs.px4.io, "ULog File Format". What the FlightLog does not hold is
NaN, as PX4 does with values that it does not have; integer fields are zero.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator, Mapping, Sequence
from typing import BinaryIO

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.data.log import POSITION_VALUES, FlightLog, Signal
from quadid_logs.maths.rotations import quaternion_from_euler
from quadid_logs.vocabulary import AXES
from quadid_logs.writers.flight_modes import find_mode
from quadid_logs.writers.log_series import (
    Stamps,
    WriteClock,
    clip_text,
    controller_rate,
    event_stamps,
    first,
    held,
    held_at,
    imu_rates,
    mav_type,
    packed_version,
    write_clock,
)
from quadid_logs.writers.records import RPM, Column, Field, Records, write_merged
from quadid_logs.writers.ulog_topics import (
    ATTITUDE_SETPOINT,
    FIFO,
    POSITIONS,
    TOPICS,
    row_type,
    whole_parameter,
)

MAGIC = b"ULog\x01\x12\x35"
VERSION = 1
#: The bytes of a sync message, by which a reader finds its way after damage.
SYNC = bytes.fromhex("2f731320250cbb12")
SYNC_PERIOD_US = 500_000
#: The PX4 release whose topics are written: 1.18.0, as ver_sw_release stores it.
DEFAULT_RELEASE = 0x011200FF
#: From the gyro's sample to the publication of what follows from it: medians
#: of flights with PX4 1.16 on an FMU v6C [µs].
LATENCY_US = {
    "vehicle_angular_velocity": 63,
    "vehicle_acceleration": 68,
    "vehicle_attitude": 219,
    "vehicle_torque_setpoint": 73,
    "vehicle_thrust_setpoint": 73,
    "actuator_motors": 91,
}
MOTORS, OUTPUTS, ESCS = 12, 16, 12
#: msg/VehicleStatus.msg: ARMING_STATE_*, VEHICLE_TYPE_ROTARY_WING.
STATE_DISARMED, STATE_ARMED, ROTARY_WING = 1, 2, 1
#: msg/EscReport.msg: ACTUATOR_FUNCTION_MOTOR1.
FUNCTION_MOTOR1 = 101

#: Samples in a row of 32 places, and a count of a range of 2000 deg/s [rad/s].
FIFO_SAMPLES, FIFO_LENGTH, GYRO_SCALE = 8, 32, math.radians(2000.0) / 32768.0

Topic = tuple[str, int, Stamps, dict[str, Field]]


def write_ulog(log: FlightLog, file: BinaryIO) -> None:
    """Write a FlightLog as ULog.

    Parameters
    ----------
    log : FlightLog
        Any autopilot's; only what PX4 logs is written. Of several IMUs the first one.
    file : binary file
        Open for writing.

    Raises
    ------
    OutputError
        If a row has no finite time.
    """
    clock = write_clock(log)
    topics = [*_rates(log, clock), *_actuators(log, clock), *_sensors(log, clock), *_states(log, clock)]
    topics += [*_fifos(log, clock), *_outer_loops(log, clock)]
    streams = [_records(number, *topic) for number, topic in enumerate(topics)]
    starts = [int(stream.key_us[0]) for stream in streams]
    ends = [int(stream.key_us[-1]) for stream in streams]
    start_us, end_us = min(starts, default=0), max(ends, default=0)
    file.write(MAGIC + struct.pack("<BQ", VERSION, start_us))
    _write_definitions(file, log)
    for number, (name, instance, _, _) in enumerate(topics):
        file.write(_message("A", struct.pack("<BH", instance, number) + name.encode()))
    written = [*_texts(log, clock), *_changed_parameters(log, clock)]
    key_us = np.arange(start_us, end_us + 1, SYNC_PERIOD_US, dtype=np.int64)
    dtype = np.dtype([("size", "<u2"), ("kind", "u1"), ("magic", f"V{len(SYNC)}")])
    magic = np.broadcast_to(np.frombuffer(SYNC, dtype=f"V{len(SYNC)}"), key_us.shape)
    write_merged(
        file,
        [
            *streams,
            *written,
            Records(dtype=dtype, key_us=key_us, fields={"size": len(SYNC), "kind": ord("S"), "magic": magic}),
        ],
    )


def _message(kind: str, content: bytes) -> bytes:
    """Put the header of size and type in front of a message."""
    return struct.pack("<HB", len(content), ord(kind)) + content


def _records(number: int, name: str, _instance: int, stamps: Stamps, fields: Mapping[str, Field]) -> Records:
    """Make the data messages of a topic."""
    row = row_type(name)
    # A data message's packed row, its header included.
    dtype = np.dtype([("size", "<u2"), ("kind", "u1"), ("number", "<u2"), ("row", row)])
    latency_us = LATENCY_US.get(name, 0)
    every_row: dict[str, Field] = {
        "size": dtype.itemsize - 3,
        "kind": ord("D"),
        "number": number,
        "row.timestamp": stamps.time_us + latency_us,
    }
    if "timestamp_sample" in (row.names or ()):
        every_row["row.timestamp_sample"] = stamps.time_us
    own = {f"row.{field}": values for field, values in fields.items()}
    return Records(dtype=dtype, key_us=stamps.key_us + latency_us, fields=every_row | own)


def _padded(values: FloatArray, n_columns: int, *, fill: float) -> FloatArray:
    """Fill up an array field that is longer than the vehicle needs, or cut it."""
    used = values[:, :n_columns]
    rest = np.full((values.shape[0], n_columns - used.shape[1]), fill)
    return np.concatenate((used, rest), axis=1)


def _upwards(throttle: FloatArray) -> FloatArray:
    """Turn a collective thrust command (n, 1) into a thrust vector in body axes (n, 3)."""
    return np.asarray(throttle * np.array([0.0, 0.0, -1.0]))


def _rates(log: FlightLog, clock: WriteClock) -> Iterator[Topic]:
    """Measured and wanted body rates, torque and thrust set-points."""
    rate = controller_rate(log)
    if rate is not None and rate.n_samples:
        # What the rate controller's D acts on, NaN where it is not known in the rate's rows.
        columns = [
            terms.values["derivative"]
            for terms in log.controller_terms
            if "derivative" in terms.values and terms.rows.n_samples == rate.n_samples
        ]
        fields: dict[str, Field] = {
            "xyz": rate.values,
            "xyz_derivative": (np.column_stack(columns) if len(columns) == len(AXES) else math.nan),
        }
        yield "vehicle_angular_velocity", 0, clock.of(rate), fields
    wanted, throttle = first(log, "body_rate_setpoint"), first(log, "throttle")
    if wanted is not None:
        stamps = clock.of(wanted)
        fields = {name: wanted.values[:, axis] for axis, name in enumerate(("roll", "pitch", "yaw"))}
        fields["thrust_body"] = _upwards(held_at(clock, throttle, stamps.key_us, 1))
        yield "vehicle_rates_setpoint", 0, stamps, fields
    torque = first(log, "torque_command")
    if torque is not None:
        yield "vehicle_torque_setpoint", 0, clock.of(torque), {"xyz": torque.values}
    if throttle is not None:
        thrust = _upwards(throttle.values)
        yield "vehicle_thrust_setpoint", 0, clock.of(throttle), {"xyz": thrust}
    unallocated = first(log, "unallocated_torque")
    if unallocated is not None:
        # ControlAllocator.cpp: achieved below a squared norm of 1e-6.
        achieved = (unallocated.values**2).sum(axis=1) < 1e-6
        fields = {
            "unallocated_torque": unallocated.values,
            "torque_setpoint_achieved": achieved.astype(np.uint8),
            "thrust_setpoint_achieved": 1,
        }
        yield "control_allocator_status", 0, clock.of(unallocated), fields


def _actuators(log: FlightLog, clock: WriteClock) -> Iterator[Topic]:
    """Motor commands before the thrust curve, output pulses, ESC speeds."""
    fields: dict[str, Field]
    motors = first(log, "motor_thrust")
    if motors is not None:
        control = _padded(motors.values, MOTORS, fill=math.nan)
        yield "actuator_motors", 0, clock.of(motors), {"control": control}
    outputs = first(log, "output_pwm")
    if outputs is not None:
        stamps = clock.of(outputs)
        for instance, channel in enumerate(range(0, outputs.values.shape[1], OUTPUTS)):
            part = outputs.values[:, channel : channel + OUTPUTS]
            fields = {
                "noutputs": part.shape[1],
                "output": _padded(part, OUTPUTS, fill=0.0),
            }
            yield "actuator_outputs", instance, stamps, fields
    speed = first(log, "rotor_speed")
    if speed is not None:
        # One report per motor, in whole revolutions per minute.
        stamps, n_escs = clock.of(speed), min(speed.values.shape[1], ESCS)
        online, used = (1 << n_escs) - 1, np.arange(ESCS) < n_escs
        functions = (FUNCTION_MOTOR1 + np.arange(ESCS)) * used
        fields = {
            "counter": np.arange(stamps.time_us.size) % 2**16,
            "esc_online_flags": online,
            "esc_armed_flags": online,
            "esc_count": n_escs,
            "esc.timestamp": stamps.time_us[:, np.newaxis] * used,
            "esc.esc_rpm": Column(values=_padded(speed.values, ESCS, fill=0.0), scale=RPM),
            # The same in every row, without copying it.
            "esc.actuator_function": np.broadcast_to(functions, (stamps.time_us.size, ESCS)),
        }
        yield "esc_status", 0, stamps, fields


def _fifos(log: FlightLog, clock: WriteClock) -> Iterator[Topic]:
    """Put what each gyro measured into rows of eight samples, at the time of the last one."""
    for instance, signal in enumerate(one for one in log.candidates("gyro_samples") if one.raw):
        stamps = clock.of(signal)
        n_rows = signal.n_samples // FIFO_SAMPLES
        last = FIFO_SAMPLES * np.arange(1, n_rows + 1) - 1
        values = signal.values[: n_rows * FIFO_SAMPLES].reshape(n_rows, FIFO_SAMPLES, 3) / GYRO_SCALE
        fields: dict[str, Field] = {
            axis: np.pad(values[:, :, number], ((0, 0), (0, FIFO_LENGTH - FIFO_SAMPLES)))
            for number, axis in enumerate("xyz")
        }
        fields |= {
            "dt": float(np.median(np.diff(stamps.time_us))),
            "scale": GYRO_SCALE,
            "samples": FIFO_SAMPLES,
        }
        yield FIFO, instance, Stamps(time_us=stamps.time_us[last], key_us=stamps.key_us[last]), fields


def _outer_loops(log: FlightLog, clock: WriteClock) -> Iterator[Topic]:
    """Attitude set-points; set-points and states of position controllers, at the rows of the first one."""
    wanted = first(log, "attitude_setpoint")
    if wanted is not None:
        # Without a rate about the vertical.
        fields: dict[str, Field] = {"q_d": quaternion_from_euler(wanted.values), "thrust_body": math.nan}
        yield ATTITUDE_SETPOINT, 0, clock.of(wanted), fields
    if not log.position_control:
        return
    rows = log.position_control[0].rows
    stamps, unknown = clock.stamps(rows.time_s, rows.position), np.full(rows.n_samples, math.nan)
    known = {each.direction: each.values for each in log.position_control if each.rows is rows}
    columns = {
        name: [known.get(direction, {}).get(name, unknown) for direction in ("north", "east", "down")]
        for name in POSITION_VALUES
    }
    vectors = {name: np.column_stack(each) for name, each in columns.items()}
    setpoint, state, path = POSITIONS
    yield (
        path,
        0,
        stamps,
        {
            "position": vectors["position_target"],
            "velocity": vectors["velocity_forward"],
            "acceleration": vectors["acceleration_forward"],
            **dict.fromkeys(("jerk", "yaw", "yawspeed"), math.nan),
        },
    )
    yield state, 0, stamps, _named(columns["position"], "") | _named(columns["velocity"], "v")
    yield (
        setpoint,
        0,
        stamps,
        {
            **_named(columns["position_target"], ""),
            **_named(columns["velocity_target"], "v"),
            "acceleration": vectors["acceleration_target"],
            **dict.fromkeys(("thrust", "yaw", "yawspeed"), math.nan),
        },
    )


def _named(columns: Sequence[FloatArray], prefix: str) -> dict[str, Field]:
    """Name the fields of a vector's components, such as vx, vy, vz."""
    return {f"{prefix}{letter}": each for letter, each in zip("xyz", columns, strict=True)}


def _sensors(log: FlightLog, clock: WriteClock) -> Iterator[Topic]:
    """Attitude as a quaternion, the first IMU, the battery."""
    attitude = first(log, "attitude")
    if attitude is not None:
        fields: dict[str, Field] = {"q": quaternion_from_euler(attitude.values), "delta_q_reset": math.nan}
        yield "vehicle_attitude", 0, clock.of(attitude), fields
    rate, force = next(iter(imu_rates(log)), None), first(log, "specific_force")
    if rate is not None and rate.n_samples:
        stamps = clock.of(rate)
        period_us = float(np.median(np.diff(stamps.time_us))) if rate.n_samples > 1 else 0.0
        fields = {
            "gyro_rad": rate.values,
            "gyro_integral_dt": period_us,
            "accelerometer_m_s2": held_at(clock, force, stamps.key_us, 3),
            "accelerometer_integral_dt": period_us,
        }
        yield "sensor_combined", 0, stamps, fields
    elif force is not None:
        yield "vehicle_acceleration", 0, clock.of(force), {"xyz": force.values}
    voltage = first(log, "battery_voltage")
    if voltage is not None:
        unknown: dict[str, Field] = dict.fromkeys(
            ("current_a", "current_average_a", "discharged_mah", "remaining", "time_remaining_s"), math.nan
        )
        known: dict[str, Field] = {
            "voltage_v": voltage.values[:, 0],
            # msg/BatteryStatus.msg: -1 says that the scale is unknown.
            "scale": -1.0,
            "temperature": math.nan,
            "connected": 1,
            "id": 1,
        }
        yield "battery_status", 0, clock.of(voltage), unknown | known


def _states(log: FlightLog, clock: WriteClock) -> Iterator[Topic]:
    """Arming, landing and flight mode."""
    armed, landed = first(log, "armed"), first(log, "landed")
    if armed is not None:
        is_armed = armed.values[:, 0] > 0.5
        fields: dict[str, Field] = {"armed": is_armed.astype(np.uint8), "ready_to_arm": 1}
        yield "actuator_armed", 0, clock.of(armed), fields
    if landed is not None:
        is_landed = (landed.values[:, 0] > 0.5).astype(np.uint8)
        fields = dict.fromkeys(("landed", "maybe_landed", "ground_contact"), is_landed)
        yield "vehicle_land_detected", 0, clock.of(landed), fields
    yield from _status(log, clock, armed)


def _status(log: FlightLog, clock: WriteClock, armed: Signal | None) -> Iterator[Topic]:
    """vehicle_status whenever the mode changes or the arming state is logged."""
    modes = event_stamps(clock, log.modes)
    parts = [modes] if armed is None else [modes, clock.of(armed)]
    key_us = np.concatenate([part.key_us for part in parts])
    if not key_us.size:
        return
    order = np.argsort(key_us, kind="stable")
    time_us = np.concatenate([part.time_us for part in parts])[order]
    stamps = Stamps(time_us=time_us, key_us=key_us[order])
    numbers = np.array([find_mode(mode.name).nav_state for mode in log.modes], dtype=np.float64)
    is_armed = held_at(clock, armed, stamps.key_us, 1)[:, 0] > 0.5
    fields: dict[str, Field] = {
        "arming_state": np.where(is_armed, STATE_ARMED, STATE_DISARMED),
        "nav_state": held(modes, numbers, stamps.key_us),
        "nav_state_user_intention": held(modes, numbers, stamps.key_us),
        "vehicle_type": ROTARY_WING,
        "system_type": mav_type(log),
        "system_id": 1,
        "component_id": 1,
        "pre_flight_checks_pass": 1,
    }
    yield "vehicle_status", 0, stamps, fields


def _texts(log: FlightLog, clock: WriteClock) -> Iterator[Records]:
    """Make the logged text messages: one record type per length."""
    stamps = event_stamps(clock, log.texts)
    texts = [clip_text(text.text, 127) for text in log.texts]
    for row, text in enumerate(texts):
        dtype = np.dtype(
            [
                ("size", "<u2"),
                ("kind", "u1"),
                ("level", "u1"),
                ("timestamp", "<u8"),
                ("text", f"V{len(text)}"),
            ]
        )
        fields: dict[str, Field] = {
            "size": dtype.itemsize - 3,
            "kind": ord("L"),
            "level": ord("6"),
            "timestamp": stamps.time_us[row : row + 1],
            "text": np.frombuffer(text, dtype=f"V{len(text)}") if text else np.zeros(1, dtype="V0"),
        }
        yield Records(dtype=dtype, key_us=stamps.key_us[row : row + 1], fields=fields)


def _changed_parameters(log: FlightLog, clock: WriteClock) -> Iterator[Records]:
    """Make the messages of parameters that were written in flight: one record type per length."""
    stamps = event_stamps(clock, log.parameter_changes)
    for row, change in enumerate(log.parameter_changes):
        content = _parameter(clip_text(change.name, 16).decode(), change.value)
        dtype = np.dtype([("size", "<u2"), ("kind", "u1"), ("content", f"V{len(content)}")])
        fields: dict[str, Field] = {
            "size": len(content),
            "kind": ord("P"),
            "content": np.frombuffer(content, dtype=f"V{len(content)}"),
        }
        yield Records(dtype=dtype, key_us=stamps.key_us[row : row + 1], fields=fields)


def _write_definitions(file: BinaryIO, log: FlightLog) -> None:
    """Write flag bits, formats, information and parameters."""
    file.write(_message("B", bytes(40)))
    for name, fields in TOPICS.items():
        # The topics that are defined only where the log holds them.
        found = set() if log.candidates("gyro_samples") else {FIFO}
        found |= set() if log.candidates("attitude_setpoint") else {ATTITUDE_SETPOINT}
        if name in (found | (set() if log.position_control else {*POSITIONS})):
            continue
        file.write(_message("F", f"{name}:{fields}".encode()))
    is_px4 = log.firmware.upper().startswith("PX4")
    release = (packed_version(log.firmware) if is_px4 else 0) or DEFAULT_RELEASE
    texts = {
        "sys_name": "PX4",
        "ver_hw": "QUADID_SIMULATOR",
        "ver_sw": "0" * 40,
        "sys_uuid": log.hardware_id or "0" * 36,
        "sys_os_name": "NuttX",
    }
    for key, text in texts.items():
        content = clip_text(text, 64)
        file.write(_message("I", _keyed(f"char[{len(content)}] {key}", content)))
    numbers = {"ver_sw_release": ("uint32_t", release), "time_ref_utc": ("int32_t", 0)}
    for key, (kind, number) in numbers.items():
        file.write(_message("I", _keyed(f"{kind} {key}", struct.pack("<I", number))))
    for name, value in log.parameters_at(-1).items():
        file.write(_message("P", _parameter(clip_text(name, 16).decode(), value)))


def _keyed(key: str, value: bytes) -> bytes:
    """Put a key's length and text in front of its value."""
    encoded = key.encode()
    return bytes([len(encoded)]) + encoded + value


def _parameter(name: str, value: float) -> bytes:
    """Pack a parameter as the type that PX4 gives it."""
    whole = whole_parameter(name, value)
    if whole is not None:
        return _keyed(f"int32_t {name}", struct.pack("<i", whole))
    return _keyed(f"float {name}", np.float32(value).tobytes())
