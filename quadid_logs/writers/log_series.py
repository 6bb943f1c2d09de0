"""Prepare a FlightLog's series for a writer: stamps, write order, held values, changes."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from quadid_logs.arrays import AnyArray, FloatArray, IntArray
from quadid_logs.data.log import FlightLog, LogText, ModeChange, ParameterChange, Signal
from quadid_logs.errors import OutputError

#: A clock that falls by more than this has been reset; less is jitter [µs].
RESET_US = 1_000_000
#: Latest stamp that is written: far beyond any flight, still exact in 64 bits [µs].
LATEST_US = 2**62
#: How sources of single, unfiltered IMUs are named by the firmwares and by the simulator.
IMU_NAMES = ("imu", "gyr.", "gyr[", "sensor_combined", "sensor_gyro")


def microseconds(time_s: FloatArray) -> IntArray:
    """Round times [s] to the whole microseconds that all three formats store.

    Raises
    ------
    OutputError
        If a time is not finite: no format can store such a row.
    """
    if not np.isfinite(time_s).all():
        raise OutputError("A row without a finite time cannot be written.", hint="Drop such rows first.")
    # 2**62 is exact in binary64, so the comparison loses nothing.
    return np.rint(np.clip(time_s * 1e6, 0.0, float(LATEST_US))).astype(np.int64)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Stamps:
    """When rows were sampled and where in the file they belong.

    Attributes
    ----------
    time_us : ndarray of int64, shape (n_rows,)
        On the log's clock, which may fall [µs].
    key_us : ndarray of int64, shape (n_rows,)
        On a clock that never falls: rows of all messages are written in its order [µs].
    """

    time_us: IntArray
    key_us: IntArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WriteClock:
    """The log's clock between resets, continued without falling.

    Attributes
    ----------
    position : ndarray of int64, shape (n_epochs,)
        Where each epoch begins in the positions of the signal with most rows.
    end_us : ndarray of int64, shape (n_epochs,)
        The log's latest time in each epoch [µs].
    offset_us : ndarray of int64, shape (n_epochs,)
        To be added to the log's time in each epoch [µs].
    """

    position: IntArray
    end_us: IntArray
    offset_us: IntArray

    def stamps(self, time_s: FloatArray, position: IntArray) -> Stamps:
        """Stamp rows that stand in the order in which they were logged."""
        time_us = microseconds(time_s)
        epoch = np.zeros(time_us.size, dtype=np.int64)
        falls = _reset_rows(time_us)
        if falls.size == self.offset_us.size - 1:
            epoch = np.searchsorted(falls, np.arange(time_us.size), side="right")
        elif self.offset_us.size > 1:
            # Too few rows to show every reset: their place in the log tells the epoch,
            # or, where it is not known (0), a time that comes only later.
            epoch = np.maximum(np.searchsorted(self.position, position, side="right") - 1, 0)
            for earlier, end_us in enumerate(self.end_us[:-1]):
                epoch[(epoch == earlier) & (time_us > end_us)] += 1
        key_us = np.maximum.accumulate(time_us + self.offset_us[epoch])
        return Stamps(time_us=time_us, key_us=key_us)

    def of(self, signal: Signal) -> Stamps:
        """Stamp a signal's rows."""
        return self.stamps(signal.time_s, signal.position)


def _reset_rows(time_us: IntArray) -> IntArray:
    """Return the rows at which the clock has fallen."""
    return np.flatnonzero(np.diff(time_us) < -RESET_US).astype(np.int64) + 1


def write_clock(log: FlightLog) -> WriteClock:
    """Find the resets of a log's clock in its longest series."""
    series = [signal for candidates in log.signals.values() for signal in candidates]
    longest = max(series, key=lambda signal: signal.n_samples, default=None)
    if longest is None or longest.n_samples == 0:
        nothing = np.zeros(1, dtype=np.int64)
        return WriteClock(position=nothing, end_us=nothing, offset_us=nothing)
    time_us = microseconds(longest.time_s)
    starts = np.concatenate(([0], _reset_rows(time_us)))
    end_us = np.maximum.reduceat(time_us, starts)
    offset_us = np.zeros(starts.size, dtype=np.int64)
    for epoch in range(1, starts.size):
        offset_us[epoch] = end_us[epoch - 1] + offset_us[epoch - 1] + RESET_US - time_us[starts[epoch]]
    return WriteClock(position=longest.position[starts], end_us=end_us, offset_us=offset_us)


def event_stamps(
    clock: WriteClock, events: tuple[ModeChange, ...] | tuple[LogText, ...] | tuple[ParameterChange, ...]
) -> Stamps:
    """Stamp modes, texts or changes of parameters."""
    time_s = np.array([event.time_s for event in events], dtype=np.float64)
    position = np.array([event.position for event in events], dtype=np.int64)
    return clock.stamps(time_s, position)


def held(stamps: Stamps, values: AnyArray, at_us: IntArray) -> FloatArray:
    """Hold the last value of a series at other places of the file.

    Parameters
    ----------
    stamps : Stamps
        Of the series.
    values : ndarray, shape (n_rows, ...)
        Its values.
    at_us : ndarray of int64, shape (n,)
        Write keys at which they are wanted [µs].

    Returns
    -------
    ndarray, shape (n, ...)
        NaN before the first row: an unknown value is never made up.
    """
    row = np.searchsorted(stamps.key_us, at_us, side="right") - 1
    result = np.asarray(values, dtype=np.float64)[np.maximum(row, 0)] if values.shape[0] else None
    if result is None:
        return np.full((at_us.size, *values.shape[1:]), np.nan)
    result[row < 0] = np.nan
    return result


def held_at(clock: WriteClock, signal: Signal | None, key_us: IntArray, n_columns: int) -> FloatArray:
    """Hold a signal's last value at other places of the file, shape (n, n_columns); NaN where it is None."""
    if signal is None:
        return np.full((key_us.size, n_columns), np.nan)
    own = clock.of(signal)
    return signal.values if np.array_equal(own.key_us, key_us) else held(own, signal.values, key_us)


def changes(values: FloatArray, *, before: float) -> IntArray:
    """Return the rows at which a two-valued series changes, `before` being its state ahead of row 0."""
    state = (values > 0.5).astype(np.int8)
    return np.flatnonzero(np.diff(state, prepend=np.int8(before > 0.5))).astype(np.int64)


def is_imu(signal: Signal) -> bool:
    """Tell a single IMU's unfiltered series from the rate that the controller saw."""
    return any(name in signal.source.lower() for name in IMU_NAMES)


def controller_rate(log: FlightLog) -> Signal | None:
    """Return the body rate that the rate controller used, None if the log has IMU series only."""
    candidates = log.candidates("body_rate")
    chosen = [signal for signal in candidates if not is_imu(signal)]
    if not chosen and log.candidates("torque_command"):
        chosen = list(candidates)
    return chosen[0] if chosen else None


def imu_rates(log: FlightLog) -> tuple[Signal, ...]:
    """Return the body rates of the single IMUs, in order of instance."""
    used = controller_rate(log)
    return tuple(signal for signal in log.candidates("body_rate") if is_imu(signal) and signal is not used)


def first(log: FlightLog, name: str) -> Signal | None:
    """Return the preferred source of a canonical signal, None where the log has none."""
    candidates = [signal for signal in log.candidates(name) if signal.n_samples]
    return candidates[0] if candidates else None


def clip_text(text: str, n_bytes: int) -> bytes:
    """Encode a text and cut it to a field's length, never inside a character."""
    encoded = text.replace("\0", " ").encode("utf-8", errors="replace")[:n_bytes]
    return encoded.decode("utf-8", errors="ignore").encode("utf-8")


def mav_type(log: FlightLog) -> int:
    """Return the vehicle's MAV_TYPE (MAVLink common.xml), by its number of motors where that is known."""
    other = {"helicopter": 4, "fixed-wing": 1, "vtol": 22, "rover": 10, "boat": 11, "submarine": 12}
    if log.vehicle_type in other:
        return other[log.vehicle_type]
    # ArduPilot's FRAME_CLASS (AP_Motors_Class.h); PX4 counts its rotors.
    classes = {1: 2, 2: 13, 3: 14, 4: 14, 5: 13, 7: 15, 12: 29, 14: 35}
    rotors = {3: 15, 4: 2, 6: 13, 8: 14, 10: 35, 12: 29}
    frame_class = log.parameters.get("FRAME_CLASS", 0.0)
    n_rotors = log.parameters.get("CA_ROTOR_COUNT", 4.0)
    return classes.get(int(frame_class)) or rotors.get(int(n_rotors), 2)


def packed_version(firmware: str) -> int:
    """Pack a version such as "PX4 v1.16.1" into 32 bits, 0 where there is none.

    Major, minor, patch, and 255 for a release: MAVLink's
    AUTOPILOT_VERSION.flight_sw_version and ULog's ver_sw_release.
    """
    found = re.search(r"[Vv]?(\d+)\.(\d+)(?:\.(\d+))?", firmware)
    if not found:
        return 0
    major, minor, patch = (min(int(number), 255) for number in found.groups(default="0"))
    return major << 24 | minor << 16 | patch << 8 | 0xFF
