"""PX4's legacy sdlog2 log (.px4log, .bin): DataFlash's framing, PX4's messages, times in TIME records.

Fields and units: PX4 v1.0 to v1.4, src/modules/sdlog2/sdlog2_messages.h. PX4 works
in FRD and NED, in radians and SI units, so no sign or scale changes.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.autopilots.ardupilot.identity import parameter_table
from quadid_logs.autopilots.generic.mav_type import airframe_words, frame_words, vehicle_type_of
from quadid_logs.containers.dataflash import DataFlashFile, check_not_empty, is_sdlog2
from quadid_logs.containers.dataflash_index import looks_like_dataflash
from quadid_logs.containers.message_table import MessageTable, damaged_numbers_pass
from quadid_logs.data.log import FlightLog, MessageCount, ModeChange, Signal, signal_from_columns

#: ARMING_STATE_ARMED and ARMING_STATE_ARMED_ERROR of vehicle_status.msg.
_ARMED_STATES: Final = (2, 3)
#: MAIN_STATE of vehicle_status.msg, v1.0 to v1.4.
_MAIN_STATES: Final = {
    0: "MANUAL",
    1: "ALTCTL",
    2: "POSCTL",
    3: "AUTO_MISSION",
    4: "AUTO_LOITER",
    5: "AUTO_RTL",
    6: "ACRO",
    7: "OFFBOARD",
    8: "STAB",
    9: "RATTITUDE",
}


class _Source(NamedTuple):
    """One source of one canonical signal."""

    signal: str
    message: str
    labels: tuple[str, ...]
    reason: str


_OUTPUTS: Final = tuple(f"Out{number}" for number in range(8))
#: In order of preference.
_SOURCES: Final = (
    _Source("body_rate", "ATT", ("RollRate", "PitchRate", "YawRate"), "the estimator's bias-corrected rates"),
    _Source("body_rate", "IMU", ("GyroX", "GyroY", "GyroZ"), "first gyro"),
    _Source("body_rate", "IMU1", ("GyroX", "GyroY", "GyroZ"), "second gyro"),
    _Source("body_rate", "IMU2", ("GyroX", "GyroY", "GyroZ"), "third gyro"),
    _Source(
        "body_rate_setpoint",
        "ARSP",
        ("RollRateSP", "PitchRateSP", "YawRateSP"),
        "what the rate controller was asked for",
    ),
    _Source("attitude", "ATT", ("Roll", "Pitch", "Yaw"), "the estimator's attitude"),
    _Source("torque_command", "ATTC", ("Roll", "Pitch", "Yaw"), "the rate controller's output to the mixer"),
    _Source("throttle", "ATTC", ("Thrust",), "collective command to the mixer"),
    _Source("output_pwm", "OUT0", _OUTPUTS, "pulse width per output channel"),
    _Source("output_pwm", "OUT1", _OUTPUTS, "pulse width per output channel, second group"),
    _Source("specific_force", "IMU", ("AccX", "AccY", "AccZ"), "first accelerometer"),
    _Source("specific_force", "IMU1", ("AccX", "AccY", "AccZ"), "second accelerometer"),
    _Source("battery_voltage", "BATT", ("V",), "voltage of the battery"),
    _Source("armed", "STAT", ("ArmS",), "arming state"),
    _Source("landed", "STAT", ("Landed",), "land detector"),
)
_DESCRIPTIONS: Final = frozenset({"TIME", "PARM", "VER"})


class _TimeRecords:
    """The TIME records of a file: each holds for the rows that follow it."""

    def __init__(self, table: MessageTable | None) -> None:
        known = table is not None and table.has_numbers("StartTime")
        self.position = table.position if table is not None and known else np.zeros(0, np.int64)
        self.time_s = (
            table.columns["StartTime"].astype(np.float64) / 1e6
            if table is not None and known
            else np.zeros(0)
        )

    def times(self, table: MessageTable) -> FloatArray:
        """Return the time of each row [s], NaN for rows before the first TIME."""
        if not len(self.position):
            return np.full(table.n_rows, np.nan)
        before = np.searchsorted(self.position, table.position, side="right") - 1
        return np.where(before >= 0, self.time_s[np.maximum(before, 0)], np.nan)


def is_mine(head: bytes) -> bool:
    """Say whether a file that begins with these (up to 64 kB) bytes is a PX4 sdlog2 log."""
    return looks_like_dataflash(head, is_sdlog2)


def read(path: str | Path, *, system: int = 0) -> FlightLog:  # noqa: ARG001 (one vehicle per file)
    """Read a legacy PX4 log.

    Parameters
    ----------
    path : str or Path
        The file.
    system : int
        Not used: an sdlog2 file holds one vehicle.

    Raises
    ------
    LogNotFoundError, EmptyLogError, UnknownFormatError
        As `dataflash.read`.
    """
    with DataFlashFile.open(path) as file:
        check_not_empty(file)
        return _flight_log(file)


@damaged_numbers_pass()
def _flight_log(file: DataFlashFile) -> FlightLog:
    """Turn the messages into canonical signals and descriptions."""
    tables = file.read_messages({source.message for source in _SOURCES} | _DESCRIPTIONS)
    clock = _TimeRecords(tables.get("TIME"))
    parameters = _parameters(tables.get("PARM"))
    mav_type = parameters.get("MAV_TYPE", 0.0)
    autostart = parameters.get("SYS_AUTOSTART", 0.0)
    return FlightLog(
        path=file.path,
        format="dataflash",
        dialect="sdlog2",
        autopilot="px4",
        n_bytes=file.n_bytes,
        signals=_signals(tables, clock),
        firmware=_firmware(tables.get("VER")),
        vehicle_type=vehicle_type_of(_whole(mav_type)),
        frame=airframe_words(_whole(autostart)) or frame_words(_whole(mav_type)),
        hardware_id=_text(tables.get("VER"), "Arch"),
        parameters=parameters,
        modes=_modes(tables.get("STAT"), clock),
        lost=file.lost,
        counts=_counts(file, clock),
        has_time=len(clock.position) > 0,
        remarks=("Rows take the time of the TIME record before them (sdlog2 logs no other).",),
    )


def _signals(tables: dict[str, MessageTable], clock: _TimeRecords) -> dict[str, tuple[Signal, ...]]:
    """Build every source that the log holds."""
    found: dict[str, list[Signal]] = {}
    for source in _SOURCES:
        table = tables.get(source.message)
        if table is None or not table.has_numbers(*source.labels):
            continue
        columns = [table.columns[label].astype(np.float64) for label in source.labels]
        if source.signal == "armed":
            columns = [np.isin(columns[0], _ARMED_STATES).astype(np.float64)]
        signal = signal_from_columns(
            source.signal,
            clock.times(table),
            columns,
            table.position,
            source=f"{source.message}.{' '.join(source.labels)}",
            reason=source.reason,
        )
        found.setdefault(source.signal, []).append(signal)
    return {name: tuple(signals) for name, signals in found.items()}


def _parameters(table: MessageTable | None) -> dict[str, float]:
    """Return the last value of each parameter."""
    if table is None or not (table.has_text("Name") and table.has_numbers("Value")):
        return {}
    return parameter_table(table.columns["Name"].tolist(), table.columns["Value"].tolist())


def _firmware(table: MessageTable | None) -> str:
    """Return what VER says about the firmware."""
    commit = _text(table, "FwGit")
    return f"PX4 {commit[:12]}" if commit else "PX4"


def _text(table: MessageTable | None, label: str) -> str:
    """Return a text of the first row of a message."""
    return str(table.columns[label][0]) if table is not None and table.has(label) else ""


def _modes(table: MessageTable | None, clock: _TimeRecords) -> tuple[ModeChange, ...]:
    """Return the main states where they change."""
    if table is None or not table.has_numbers("MainState"):
        return ()
    state = table.integers("MainState")
    changes = np.flatnonzero(np.diff(state, prepend=-1))
    time = clock.times(table)
    return tuple(
        ModeChange(
            time_s=float(time[row]),
            position=int(table.position[row]),
            name=_MAIN_STATES.get(int(state[row]), f"mode {int(state[row])}"),
        )
        for row in changes.tolist()
    )


def _counts(file: DataFlashFile, clock: _TimeRecords) -> tuple[MessageCount, ...]:
    """Return rows and mean rate of every message type."""
    samples = file.first_and_last()
    result = []
    for name, count in sorted(file.counts.items()):
        time = clock.times(samples[name]) if name in samples else np.zeros(0)
        span = float(time[-1] - time[0]) if len(time) == 2 else 0.0
        rate_hz = (count - 1) / span if span > 0.0 else float("nan")
        result.append(MessageCount(name=name, count=count, rate_hz=rate_hz))
    return tuple(result)


def _whole(value: float) -> int:
    """Round a parameter to the integer that it means; 0 where it means none."""
    return int(value) if abs(value) < 1e6 else 0
