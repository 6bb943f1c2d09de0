"""Blackbox of Betaflight and its family, written: one main frame for each row, settings in the header.

Source of the format: ``blackbox.c``, ``blackbox_fielddefs.h``, ``blackbox_encoding.c``. Every field is a
number of variable length, as it is in complete frames and as the difference to the frame before in others,
so that all frames are written at once. Autopilot and version of the log choose fields and units.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import BinaryIO, Final, NamedTuple

import numpy as np

from quadid_logs.arrays import FloatArray, IntArray
from quadid_logs.autopilots.betaflight.flight_modes import MODE_FLAGS
from quadid_logs.autopilots.betaflight.signals import STICK, TO_FRD
from quadid_logs.autopilots.betaflight.sticks import STICK_END, sticks_of
from quadid_logs.data.log import FlightLog, Signal
from quadid_logs.errors import OutputError
from quadid_logs.maths.rotations import quaternion_from_euler
from quadid_logs.vocabulary import AXES, GRAVITY_M_S2
from quadid_logs.writers.log_series import microseconds

#: Frames from one complete frame to the next: what a fault costs at most.
_INTERVAL: Final = 32
_MAGIC: Final = b"H Product:Blackbox flight data recorder by Nicholas Sherlock\n"
_LOG_END: Final = b"E\xffEnd of log\0"
_LARGEST: Final = float(2**31 - 1)
_DEGREES: Final = 180.0 / np.pi
_RPM: Final = 30.0 / np.pi
_VERSION: Final = re.compile(r"(\w+) v(.*)")
_LIST: Final = re.compile(r"(.+)\[\d+\]")
#: Before 4.0 set-points are not logged, the voltage is in tenths, and `rcCommand[3]` begins at 1050.
_SET_POINTS_SINCE: Final = (4, 0)
#: Counts of the converter per volt, with a `vbatscale` of 110.
_COUNTS_PER_VOLT: Final = 4095.0 * 10.0 / (3.3 * 110.0)
_LEAST_STICK, _FULL_STICK = 1050.0, 2000.0
#: Of a sensor of 2000 degrees per second in 16 bits: the bits of 1 / 16.4, as Cleanflight's header has them.
_COUNTS, _COUNTS_BITS = 16.4, "0x3d79c190"
#: What a stick of Cleanflight asks for with `rates` of 75 [deg/s].
_PER_STICK: Final = (75.0 + 27.0) / 16.0 / 4.1
_STICK: Final = np.arange(-500.0, 500.5, 0.5)
#: Thousandths per degree per second that P is made of, where it has to tell what sticks ask for.
_GAIN: Final = 1.4


#: Terms of a PID.
_TERMS: Final = ("P", "I", "D")


class _Spelling(NamedTuple):
    """What a firmware calls its fields, and how the gyro, the throttle and the voltage count."""

    set_points: str = "setpoint"
    unfiltered: str = "gyroUnfilt"
    voltage: str = "vbatLatest"
    gyro: float = 1.0
    per_volt: float = 100.0
    sticks: bool = False
    #: Of `rcCommand[3]`; none where the throttle is `setpoint[3]`.
    throttle: tuple[float, float] | None = None
    euler: bool = False


def write_blackbox(log: FlightLog, file: BinaryIO) -> None:
    """Write the rows of the first body rate, with the signals that stand in the same rows.

    Raises
    ------
    OutputError
        If the log has no body rates, or a row without a finite time.
    """
    rates = log.candidates("body_rate")
    if not rates:
        raise OutputError("A log without body rates cannot be written as Blackbox.", hint="Choose .ulg.")
    time_us = microseconds(rates[0].time_s)
    main = [each for signals in log.signals.values() for each in signals if each.rows is rates[0].rows]
    columns: dict[str, FloatArray] = {}
    spelling = _spelling(log)
    for signal in main:
        columns |= _columns(signal, log, spelling, first=signal is rates[0])
    columns |= _terms(log, rates[0], columns)
    if spelling.gyro != 1.0:
        # P as the law makes it of sticks and gyro, and the rest of the sum as I.
        found: dict[str, FloatArray] = {}
        for axis in range(3):
            names = [f"{field}[{axis}]" for field in (STICK, "gyroADC", "axisP")]
            if all(name in columns for name in names):
                stick, gyro, whole = (columns[name] for name in names)
                p = np.rint(_GAIN * (_PER_STICK * np.rint(stick) - np.rint(gyro) / spelling.gyro))
                found |= {names[2]: p, f"axisI[{axis}]": whole - p}
        columns |= found
    file.write(_MAGIC)
    for name, text in _header(log, ("loopIteration", "time", *columns)).items():
        file.write(f"H {name}:{text}\n".encode())
    fields = np.nan_to_num(np.column_stack([*columns.values()]), nan=0.0, posinf=_LARGEST, neginf=-_LARGEST)
    whole = np.rint(np.clip(fields, -_LARGEST, _LARGEST)).astype(np.int64)
    # The clock of 32 bits begins anew after 71 minutes.
    counted = [np.arange(len(time_us)), time_us & 0xFFFFFFFF]
    # The slow frames, which hold the flight mode, with the row of the main frame behind each.
    time_s = rates[0].time_s
    rows = np.searchsorted(time_s, [mode.time_s for mode in log.modes])
    for frames in _frames(
        np.column_stack([*counted, whole]),
        [
            (int(row), b"S" + bytes([MODE_FLAGS.get(mode.name, 0)]))
            for row, mode in zip(rows, log.modes, strict=True)
            if row < len(time_s)
        ],
    ):
        file.write(frames)
    file.write(b"E\x0f\0" + _LOG_END)


def _spelling(log: FlightLog) -> _Spelling:
    """Return how the log's firmware writes."""
    outputs = tuple(log.parameters.get(f"motorOutput[{end}]", (1000.0, 2000.0)[end]) for end in (0, 1))
    if log.autopilot == "inav":
        return _Spelling("axisRate", "gyroRaw", "vbat", throttle=(outputs[0], outputs[1]), euler=True)
    if log.autopilot == "cleanflight":
        return _Spelling(
            gyro=_COUNTS, per_volt=_COUNTS_PER_VOLT, sticks=True, throttle=(outputs[0], outputs[1])
        )
    if log.version is not None and log.version < _SET_POINTS_SINCE:
        return _Spelling(per_volt=10.0, sticks=True, throttle=(_LEAST_STICK, _FULL_STICK))
    return _Spelling()


def _sticks(set_points: FloatArray, log: FlightLog) -> FloatArray:
    """Return the sticks that ask for set-points [deg/s], in the log's own signs."""
    sticks = sticks_of(log.parameters, log.version)
    if sticks is None:
        return np.asarray(set_points / _PER_STICK)
    columns = [np.interp(set_points[:, axis], sticks.rate(axis, _STICK), _STICK) for axis in range(3)]
    # As the firmware does it: behind its interpolation a stick is cut to a whole number.
    return np.column_stack([np.trunc(one) if sticks.cut[k] else one for k, one in enumerate(columns)])


def _columns(signal: Signal, log: FlightLog, spelling: _Spelling, *, first: bool) -> dict[str, FloatArray]:
    """Return the fields that hold a signal; none for a signal that has no field."""
    values, settings = signal.values, log.parameters
    tenths = 10.0 if settings.get("blackbox_high_resolution") else 1.0
    forward_left_up = values * TO_FRD if values.shape[1] == 3 else values
    if signal.name == "body_rate":
        name = "gyroADC" if first else spelling.unfiltered
        return _named(name, forward_left_up * _DEGREES * tenths * spelling.gyro)
    if signal.name == "body_rate_setpoint":
        rates = forward_left_up * _DEGREES
        return (
            _named(STICK, _sticks(rates, log))
            if spelling.sticks
            else _named(spelling.set_points, rates * tenths)
        )
    if signal.name == "stick":
        return _named(STICK, values * TO_FRD[:2] * STICK_END * tenths)
    if signal.name == "torque_command":
        return _named("axisP", forward_left_up * 1000.0)
    if signal.name == "throttle":
        if spelling.throttle is None:
            return {"setpoint[3]": values[:, 0] * 1000.0}
        low, high = spelling.throttle
        return {f"{STICK}[3]": low + (high - low) * values[:, 0]}
    if signal.name == "specific_force":
        return _named("accSmooth", forward_left_up * settings.get("acc_1G", 2048.0) / GRAVITY_M_S2)
    if signal.name == "attitude" and spelling.euler:
        return _named("attitude", values * [1.0, -1.0, 1.0] * _DEGREES * 10.0)
    if signal.name == "attitude":
        w, *xyz = quaternion_from_euler(values).T
        return _named(
            "imuQuaternion", np.column_stack(xyz) * np.where(w < 0, -1, 1)[:, None] * TO_FRD * 32767
        )
    if signal.name == "motor_thrust":
        low, high = settings.get("motorOutput[0]", 48.0), settings.get("motorOutput[1]", 2047.0)
        return _named("motor", low + (high - low) * values)
    if signal.name == "rotor_speed":
        return _named("eRPM", values * _RPM * settings.get("motor_poles", 14.0) / 2.0 / 100.0)
    return {spelling.voltage: values[:, 0] * spelling.per_volt} if signal.name == "battery_voltage" else {}


def _terms(log: FlightLog, rates: Signal, columns: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """Return the fields of the PID's terms, none without terms.

    What the torque command in ``columns`` has beside P, I and D stands in F.
    """
    found: dict[str, FloatArray] = {}
    for terms in log.controller_terms:
        number = AXES.index(terms.axis)
        whole = columns.get(f"axisP[{number}]")
        if whole is None or not np.array_equal(terms.rows.position, rates.position):
            continue
        own = {
            f"axis{term}[{number}]": TO_FRD[number] * terms.values[term] * 1000.0
            for term in _TERMS
            if term in terms.values
        }
        found |= own | {f"axisF[{number}]": whole - sum(own.values(), np.zeros_like(whole))}
    return found


def _named(field: str, values: FloatArray) -> dict[str, FloatArray]:
    return {f"{field}[{number}]": column for number, column in enumerate(values.T)}


def _header(log: FlightLog, names: tuple[str, ...]) -> dict[str, str]:
    """Return the header's lines: what the frames hold and how, then the settings."""
    n, unsigned = len(names), ("loopIteration", "time")
    lists = {
        "Field I name": names,
        "Field I signed": [0 if name in unsigned else 1 for name in names],
        "Field I predictor": [0] * n,
        "Field I encoding": [1 if name in unsigned else 0 for name in names],
        "Field P predictor": [6, *[1] * (n - 1)],
        "Field P encoding": [9, *[0] * (n - 1)],
    }
    lines = {"Data version": "2", "I interval": str(_INTERVAL), "P interval": "1/1"}
    lines |= {name: ",".join(map(str, each)) for name, each in lists.items()}
    if log.modes:
        lines |= {"Field S name": "flightModeFlags", "Field S signed": "0", "Field S predictor": "0"}
        lines["Field S encoding"] = "1"
    version = _VERSION.match(log.firmware)
    firmware = {
        # Most of the family called their type alike.
        "Firmware type": "Betaflight" if _spelling(log) == _Spelling() else "Cleanflight",
        "Firmware revision": f"{version[1]} {version[2]}" if version else "Betaflight 2025.12.1",
        "gyro_scale": "0x3f800000",
    }
    if log.autopilot == "cleanflight":
        firmware = {"Firmware type": "Cleanflight", "Firmware revision": "bdaf8ec"}
        firmware["gyro.scale"] = _COUNTS_BITS
    lines |= firmware
    lines |= {
        "Log start datetime": "0000-01-01T00:00:00.000+00:00",
        "Craft name": _line(log.vehicle_name),
    }
    for name, value in log.parameters.items():
        of_list = _LIST.fullmatch(name)
        key = _line(of_list[1] if of_list else name)
        lines[key] = f"{lines[key]},{value:.10g}" if of_list and key in lines else f"{value:.10g}"
    return lines


def _line(text: str) -> str:
    """Return what stands in one line of a header."""
    return "".join(character for character in text if character.isprintable())


def _frames(rows: IntArray, slow: list[tuple[int, bytes]]) -> list[bytes]:
    """Write rows (n_rows, n_fields), loops and time first: complete at each `_INTERVAL`-th loop.

    ``slow``: frames in the order of the rows before which they stand.
    """
    complete = rows[:, 0] % _INTERVAL == 0
    change = np.diff(rows, axis=0, prepend=rows[:1])
    left = np.where(complete[:, None], rows, (change + 2**31) % 2**32 - 2**31)
    number = ((left << 1) ^ (left >> 63)) & 0xFFFFFFFF
    number[complete, :2] = rows[complete, :2]
    size = np.searchsorted([1 << 7 * k for k in range(1, 5)], number, side="right") + 1
    # Loops are not written between complete frames: each is one later than the last.
    size[~complete, 0] = 0
    end = np.cumsum(1 + size.sum(axis=1))
    start = np.append(0, end[:-1])
    content = np.zeros(int(end[-1]) if len(end) else 0, np.uint8)
    content[start] = np.where(complete, ord("I"), ord("P"))
    at = start[:, None] + 1 + np.cumsum(size, axis=1) - size
    for k in range(5):
        # Write the `k`-th byte of numbers of variable length: seven bits, the highest says that more follow.
        has = size > k
        seven_bits = (number[has] >> 7 * k) & 127
        content[at[has] + k] = seven_bits | np.where(size[has] > k + 1, 128, 0)
    written, begin = [], 0
    for row, frame in slow:
        written += [content[begin : start[row]].tobytes(), frame]
        begin = int(start[row])
    return [*written, content[begin:].tobytes()]
