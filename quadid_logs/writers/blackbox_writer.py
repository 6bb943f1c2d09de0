"""Betaflight's Blackbox, written: one main frame for each row, settings in the header.

Source of the format: ``blackbox.c``, ``blackbox_fielddefs.h``, ``blackbox_encoding.c``. Every field is a
number of variable length, as it is in complete frames and as the difference to the frame before in others,
so that all frames are written at once.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import BinaryIO, Final

import numpy as np
from numpy.typing import NDArray

from quadid_logs.arrays import FloatArray, IntArray
from quadid_logs.autopilots.betaflight.signals import TO_FRD
from quadid_logs.data.log import FlightLog, Signal
from quadid_logs.errors import OutputError
from quadid_logs.maths.rotations import quaternion_from_euler
from quadid_logs.writers.log_series import microseconds

#: Frames from one complete frame to the next: what a fault costs at most.
_INTERVAL: Final = 32
_MAGIC: Final = b"H Product:Blackbox flight data recorder by Nicholas Sherlock\n"
_LOG_END: Final = b"E\xffEnd of log\0"
_LARGEST: Final = float(2**31 - 1)
_DEGREES: Final = 180.0 / np.pi
_GRAVITY: Final = 9.80665
_RPM: Final = 30.0 / np.pi
_VERSION: Final = re.compile(r"(\w+) v(.*)")
_LIST: Final = re.compile(r"(.+)\[\d+\]")


def write_blackbox(log: FlightLog, file: BinaryIO) -> None:
    """Write the rows of the first body rate, with the signals that stand in the same rows.

    Parameters
    ----------
    log : FlightLog
    file : BinaryIO

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
    for signal in main:
        columns |= _columns(signal, log.parameters, first=signal is rates[0])
    file.write(_MAGIC)
    for name, text in _header(log, ("loopIteration", "time", *columns)).items():
        file.write(f"H {name}:{text}\n".encode())
    # The clock of 32 bits begins anew after 71 minutes.
    whole = [np.arange(len(time_us)), time_us & 0xFFFFFFFF, *map(_whole, columns.values())]
    file.write(_frames(np.stack(whole, axis=1)))
    file.write(b"E\x0f\0" + _LOG_END)


def _whole(column: FloatArray) -> IntArray:
    """Round to what 32 bits hold."""
    known = np.nan_to_num(column, nan=0.0, posinf=_LARGEST, neginf=-_LARGEST)
    return np.asarray(np.rint(np.clip(known, -_LARGEST, _LARGEST)), dtype=np.int64)


def _columns(signal: Signal, settings: Mapping[str, float], *, first: bool) -> dict[str, FloatArray]:
    """Return the fields that hold a signal; none for a signal that has no field."""
    values = signal.values
    tenths = 10.0 if settings.get("blackbox_high_resolution") else 1.0
    forward_left_up = values * TO_FRD if values.shape[1] == 3 else values
    if signal.name == "body_rate":
        return _named("gyroADC" if first else "gyroUnfilt", forward_left_up * _DEGREES * tenths)
    if signal.name == "body_rate_setpoint":
        return _named("setpoint", forward_left_up * _DEGREES * tenths)
    if signal.name == "torque_command":
        return _named("axisP", forward_left_up * 1000.0)
    if signal.name == "throttle":
        return {"setpoint[3]": values[:, 0] * 1000.0}
    if signal.name == "specific_force":
        return _named("accSmooth", forward_left_up * settings.get("acc_1G", 2048.0) / _GRAVITY)
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
    return {"vbatLatest": values[:, 0] * 100.0} if signal.name == "battery_voltage" else {}


def _named(field: str, values: FloatArray) -> dict[str, FloatArray]:
    return {f"{field}[{number}]": column for number, column in enumerate(values.T)}


def _header(log: FlightLog, names: tuple[str, ...]) -> dict[str, str]:
    """Return the header's lines: what the frames hold and how, then the settings."""
    version = _VERSION.match(log.firmware)
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
    lines |= {
        "Firmware type": "Betaflight",
        "Firmware revision": f"{version[1]} {version[2]}" if version else "Betaflight 2025.12.1",
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


def _frames(rows: IntArray) -> bytes:
    """Write rows (n_rows, n_fields), loops and time first: complete at each `_INTERVAL`-th loop."""
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
        _put(content, number, size, at, k)
    return content.tobytes()


def _put(content: NDArray[np.uint8], number: IntArray, size: IntArray, at: IntArray, k: int) -> None:
    """Write the `k`-th byte of numbers of variable length: seven bits, the highest says that more follow."""
    has = size > k
    seven_bits = (number[has] >> 7 * k) & 127
    content[at[has] + k] = seven_bits | np.where(size[has] > k + 1, 128, 0)
