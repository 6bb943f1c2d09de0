"""MAVLink telemetry log (.tlog) as a ground station records it, packet by packet.

Field meanings: mavlink common.xml and ardupilotmega.xml; RAW_IMU in mG and
mrad/s as ArduPilot fills it (GCS_Common.cpp, `send_raw_imu`).
"""

from __future__ import annotations

import heapq
import math
import struct
from collections.abc import Iterable, Iterator
from itertools import zip_longest
from typing import BinaryIO

import numpy as np

from quadid_logs.arrays import AnyArray
from quadid_logs.data.log import FlightLog, Signal
from quadid_logs.vocabulary import GRAVITY_M_S2
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
from quadid_logs.writers.mavlink_packets import Message, Messages, packet
from quadid_logs.writers.records import RPM, fit
from quadid_logs.writers.ulog_topics import whole_parameter

#: Host time of the log's zero: 2025-01-01 00:00 UTC [µs]. Fixed, so that the bytes are.
HOST_EPOCH_US = 1_735_689_600_000_000
HEARTBEAT_PERIOD_US = 1_000_000
TEXT_BYTES = 50
SYSTEM_ID, COMPONENT_ID = 1, 1
#: MAV_AUTOPILOT_*.
AUTOPILOTS = {"ardupilot": 3, "px4": 12}
#: MAV_MODE_FLAG: custom mode, stabilised, manual input; and armed.
BASE_MODE, ARMED_FLAG = 1 + 16 + 64, 128
#: MAV_STATE_*, MAV_LANDED_STATE_*, MAV_PARAM_TYPE_*, MAV_SEVERITY_INFO.
STANDBY, ACTIVE = 3, 4
ON_GROUND, IN_AIR = 1, 2
PARAM_INT32, PARAM_REAL32 = 6, 9
SEVERITY_INFO = 6

#: A message and its place in the file [µs].
Timed = tuple[int, Message]


def write_tlog(log: FlightLog, file: BinaryIO) -> None:
    """Write a FlightLog as a MAVLink 2 telemetry log.

    ATTITUDE stands at the times of `body_rate`, where there is one: angles
    hold their last value there, rates are never repeated.

    Parameters
    ----------
    log : FlightLog
        `autopilot` chooses between ArduPilot's and PX4's messages.
    file : binary file
        Open for writing.

    Raises
    ------
    OutputError
        If a row has no finite time.
    """
    messages, clock = Messages(), write_clock(log)
    streams = (
        _greeting,
        _heartbeats,
        _attitude,
        _targets,
        _imus,
        _outputs,
        _rotor_speed,
        _battery,
        _landed,
        _texts,
    )
    merged = _merged(stream(messages, log, clock) for stream in streams)
    for number, (key_us, message) in enumerate(merged):
        sent = packet(message, number % 256, SYSTEM_ID, COMPONENT_ID)
        file.write(struct.pack(">Q", HOST_EPOCH_US + key_us) + sent)


def _merged(streams: Iterable[Iterator[Timed]]) -> Iterator[Timed]:
    """Put messages in the order of their places; at one place the earlier stream comes first."""
    return heapq.merge(*streams, key=lambda timed: timed[0])


def _boot_ms(stamps: Stamps) -> list[int]:
    """Return time_boot_ms: whole milliseconds, cut off as the autopilot does; wraps after 49 days."""
    return list((stamps.time_us // 1000 % 2**32).tolist())


def _span(log: FlightLog, clock: WriteClock) -> tuple[int, int]:
    """Return the first and the last place that a series has in the file [µs]."""
    series = [signal for candidates in log.signals.values() for signal in candidates if signal.n_samples]
    keys = [clock.of(signal).key_us for signal in series] + [event_stamps(clock, log.modes).key_us]
    edges = [(int(key[0]), int(key[-1])) for key in keys if key.size]
    return min((low for low, _ in edges), default=0), max((high for _, high in edges), default=0)


def _greeting(messages: Messages, log: FlightLog, clock: WriteClock) -> Iterator[Timed]:
    """AUTOPILOT_VERSION and all parameters, as a ground station asks for them on connecting."""
    start_us, _ = _span(log, clock)
    none = bytes(8)
    yield (
        start_us,
        messages.autopilot_version(0, packed_version(log.firmware), 0, 0, 0, none, none, none, 0, 0, 0),
    )
    for index, (name, value) in enumerate(log.parameters.items()):
        number, kind = float(np.float32(value)), PARAM_REAL32
        whole = whole_parameter(name, value) if log.autopilot == "px4" else None
        if whole is not None:
            # PX4 sends an integer's bytes in the float.
            (number,), kind = struct.unpack("<f", struct.pack("<i", whole)), PARAM_INT32
        yield (
            start_us,
            messages.param_value(clip_text(name, 16), number, kind, len(log.parameters), index),
        )


def _heartbeats(messages: Messages, log: FlightLog, clock: WriteClock) -> Iterator[Timed]:
    """HEARTBEAT once a second: type, mode, armed."""
    start_us, end_us = _span(log, clock)
    key_us = np.arange(start_us, end_us + 1, HEARTBEAT_PERIOD_US, dtype=np.int64)
    modes = event_stamps(clock, log.modes)
    known = [find_mode(mode.name) for mode in log.modes]
    numbers = [mode.ardupilot for mode in known]
    if log.autopilot == "px4":
        # Main and sub mode stand in the upper bytes.
        numbers = [mode.px4_main << 16 | mode.px4_sub << 24 for mode in known]
    custom = np.array(numbers, dtype=np.float64)
    mode = np.nan_to_num(held(modes, custom, key_us)).astype(np.int64)
    armed = held_at(clock, first(log, "armed"), key_us, 1)[:, 0] > 0.5
    autopilot, vehicle = AUTOPILOTS.get(log.autopilot, 0), mav_type(log)
    for key, number, is_armed in zip(key_us.tolist(), mode.tolist(), armed.tolist(), strict=True):
        base = BASE_MODE | (ARMED_FLAG if is_armed else 0)
        state = ACTIVE if is_armed else STANDBY
        yield key, messages.heartbeat(vehicle, autopilot, base, number, state, 3)


def _attitude(messages: Messages, log: FlightLog, clock: WriteClock) -> Iterator[Timed]:
    """ATTITUDE: angles and body rates together."""
    attitude, rate = first(log, "attitude"), controller_rate(log)
    base = rate if rate is not None and rate.n_samples else attitude
    if base is None:
        return
    stamps = clock.of(base)
    angles, rates = (held_at(clock, signal, stamps.key_us, 3) for signal in (attitude, rate))
    rows = np.concatenate((angles, rates), axis=1).tolist()
    for key, boot_ms, row in zip(stamps.key_us.tolist(), _boot_ms(stamps), rows, strict=True):
        yield key, messages.attitude(boot_ms, *row)


def _targets(messages: Messages, log: FlightLog, clock: WriteClock) -> Iterator[Timed]:
    """ATTITUDE_TARGET: wanted rates and thrust; the wanted attitude is unknown."""
    wanted = first(log, "body_rate_setpoint")
    if wanted is None:
        return
    stamps = clock.of(wanted)
    thrust = held_at(clock, first(log, "throttle"), stamps.key_us, 1)
    rows = np.concatenate((wanted.values, thrust), axis=1).tolist()
    unknown = [math.nan] * 4
    for key, boot_ms, row in zip(stamps.key_us.tolist(), _boot_ms(stamps), rows, strict=True):
        yield key, messages.attitude_target(boot_ms, 0, unknown, *row)


def _imus(messages: Messages, log: FlightLog, clock: WriteClock) -> Iterator[Timed]:
    """RAW_IMU, SCALED_IMU2 and SCALED_IMU3 of ArduPilot; HIGHRES_IMU of PX4."""
    pairs = [*zip_longest(imu_rates(log), log.candidates("specific_force"))]
    n_imus = 1 if log.autopilot == "px4" else 3
    return _merged(
        _imu(messages, log, clock, instance, *pair) for instance, pair in enumerate(pairs[:n_imus])
    )


def _imu(
    messages: Messages,
    log: FlightLog,
    clock: WriteClock,
    instance: int,
    rate: Signal | None,
    force: Signal | None,
) -> Iterator[Timed]:
    """Gyro and accelerometer at the gyro's times: ArduPilot's in mrad/s and mG, PX4's in SI units."""
    base = rate if rate is not None else force
    if base is None or not base.n_samples:
        return
    stamps = clock.of(base)
    rows = np.concatenate([held_at(clock, signal, stamps.key_us, 3) for signal in (force, rate)], axis=1)
    times = stamps.time_us.tolist() if instance == 0 else _boot_ms(stamps)
    if log.autopilot == "px4":
        # The lowest six bits name the updated fields.
        make, rest = messages.highres_imu, [*[math.nan] * 7, 0b111111]
    else:
        make, rest = (messages.raw_imu, messages.scaled_imu2, messages.scaled_imu3)[instance], [0, 0, 0]
        rows = fit(rows * np.repeat([1000.0 / GRAVITY_M_S2, 1000.0], 3), np.dtype(np.int16))
    for key, time, row in zip(stamps.key_us.tolist(), times, rows.tolist(), strict=True):
        yield key, make(time, *row, *rest)


def _outputs(messages: Messages, log: FlightLog, clock: WriteClock) -> Iterator[Timed]:
    """SERVO_OUTPUT_RAW, one port per 16 channels."""
    outputs = first(log, "output_pwm")
    if outputs is None:
        return
    stamps = clock.of(outputs)
    pulses = fit(outputs.values, np.dtype(np.uint16))
    # The field has 32 bits and wraps after 71 minutes.
    times = (stamps.time_us % 2**32).tolist()
    ports = [_filled(pulses[:, start : start + 16], 16) for start in range(0, pulses.shape[1], 16)]
    for row, (key, time_us) in enumerate(zip(stamps.key_us.tolist(), times, strict=True)):
        for port, channels in enumerate(ports):
            yield key, messages.servo_output_raw(time_us, port, *channels[row])


def _filled(values: AnyArray, n_columns: int) -> list[list[int]]:
    """Fill rows up with zeros."""
    return list(np.pad(values, ((0, 0), (0, n_columns - values.shape[1]))).tolist())


def _rotor_speed(messages: Messages, log: FlightLog, clock: WriteClock) -> Iterator[Timed]:
    """ESC_TELEMETRY for up to twelve rotors, in whole revolutions per minute."""
    speed = first(log, "rotor_speed")
    if speed is None:
        return
    rpm = fit(speed.values * RPM, np.dtype(np.uint16))
    makers = (
        messages.esc_telemetry_1_to_4,
        messages.esc_telemetry_5_to_8,
        messages.esc_telemetry_9_to_12,
    )
    groups = [_filled(rpm[:, start : start + 4], 4) for start in range(0, min(rpm.shape[1], 12), 4)]
    none = [0] * 4
    for row, key in enumerate(clock.of(speed).key_us.tolist()):
        for make, group in zip(makers, groups, strict=False):
            yield key, make(bytes(4), none, none, none, group[row], none)


def _battery(messages: Messages, log: FlightLog, clock: WriteClock) -> Iterator[Timed]:
    """SYS_STATUS: the voltage in mV, no current sensor."""
    voltage = first(log, "battery_voltage")
    if voltage is None:
        return
    millivolts = fit(voltage.values[:, 0] * 1000.0, np.dtype(np.uint16)).tolist()
    for key, value in zip(clock.of(voltage).key_us.tolist(), millivolts, strict=True):
        yield key, messages.sys_status(0, 0, 0, 0, value, -1, -1, 0, 0, 0, 0, 0, 0)


def _landed(messages: Messages, log: FlightLog, clock: WriteClock) -> Iterator[Timed]:
    """EXTENDED_SYS_STATE: on ground or in the air."""
    landed = first(log, "landed")
    if landed is None:
        return
    states = np.where(landed.values[:, 0] > 0.5, ON_GROUND, IN_AIR).tolist()
    for key, state in zip(clock.of(landed).key_us.tolist(), states, strict=True):
        yield key, messages.extended_sys_state(0, state)


def _texts(messages: Messages, log: FlightLog, clock: WriteClock) -> Iterator[Timed]:
    """STATUSTEXT; a long text in chunks with one id."""
    keys = event_stamps(clock, log.texts).key_us.tolist()
    for number, (key, text) in enumerate(zip(keys, log.texts, strict=True), start=1):
        encoded = clip_text(text.text, TEXT_BYTES * 255)
        chunks = [encoded[i : i + TEXT_BYTES] for i in range(0, len(encoded), TEXT_BYTES)] or [b""]
        shared_id = number % 2**16 if len(chunks) > 1 else 0
        for sequence, chunk in enumerate(chunks):
            yield key, messages.statustext(SEVERITY_INFO, chunk, shared_id, sequence)
